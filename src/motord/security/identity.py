"""The folder that somebody on another computer holds: a certificate, its key, the authority's.

`certificate.pem`, `key.pem`, `ca.pem`, and `identity.toml` with name and role, which is there to be
shown: what counts is the certificate and the roles file of the bench.
"""

import ssl
from dataclasses import dataclass
from pathlib import Path

from motord.security.roles import SecurityError
from motord.untrusted import parse_toml, read_bytes, read_text

CA, CERTIFICATE, KEY, ABOUT = "ca.pem", "certificate.pem", "key.pem", "identity.toml"


@dataclass(frozen=True)
class Identity:
    """Who a client is: the files of its folder, its name and the role it was made with."""

    folder: Path
    name: str
    role: str

    @property
    def ca(self) -> Path:
        """The certificate of the authority that made it."""
        return self.folder / CA

    @property
    def certificate(self) -> Path:
        """Its certificate."""
        return self.folder / CERTIFICATE

    @property
    def key(self) -> Path:
        """Its private key."""
        return self.folder / KEY


def load(folder: Path) -> Identity:
    """Return the identity in `folder`. Raises SecurityError for files missing or not fitting."""
    path = folder / ABOUT
    try:
        about = parse_toml(read_text(path))
        identity = Identity(folder.resolve(), str(about["name"]), str(about["role"]))
    except OSError as error:
        raise SecurityError(
            f"{path}: cannot read it: {error.strerror}; an identity is a folder made by "
            "`motord security add`"
        ) from None
    except (ValueError, KeyError) as error:
        raise SecurityError(f"{path}: not an identity: {error}") from None
    check_files(identity.ca, identity.certificate, identity.key)
    return identity


def check_files(ca: Path, certificate: Path, key: Path) -> None:
    """Check that the files can be read and that key and certificate fit. Raises SecurityError."""
    for path in (ca, certificate, key):
        try:
            read_bytes(path)
        except OSError as error:
            raise SecurityError(f"{path}: cannot read it: {error.strerror}") from None
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        context.load_verify_locations(ca)
    except ssl.SSLError:
        raise SecurityError(f"{ca}: holds no certificate of an authority (PEM)") from None
    try:
        context.load_cert_chain(certificate, key, password="")  # else OpenSSL asks the terminal
    except ssl.SSLError:
        raise SecurityError(
            f"{certificate} and {key}: no certificate and its key (PEM, not encrypted)"
        ) from None
