"""A small certificate authority in a folder: one bench, or the benches of one laboratory.

It makes ECDSA P-256 certificates: its own, one for the daemon, one for each client. Nothing that is
there is ever overwritten, and keys can be read by their owner only.
"""

import datetime
import ipaddress
import os
import secrets
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from motord.security import roles
from motord.security.identity import ABOUT, CA, CERTIFICATE, KEY
from motord.security.roles import ROLES, Role, SecurityError, check_name

CA_DAYS = 3650
CERTIFICATE_DAYS = 730
CLOCKS_APART = datetime.timedelta(hours=1)
CLIENTS = "clients"

Usage = ExtendedKeyUsageOID


def init(folder: Path, hosts: Sequence[str], days: int = CERTIFICATE_DAYS) -> None:
    """Make an authority, a certificate for the daemon reached as `hosts`, and an empty roles file.

    Raises SecurityError if there is one already.
    """
    names = _alternative_names(["localhost", "127.0.0.1", "::1", *hosts])
    for name in ("ca.pem", "ca.key", "server.pem", "server.key", ROLES):
        if (folder / name).exists():
            raise SecurityError(f"{folder / name} exists; nothing is overwritten")
    folder.mkdir(parents=True, exist_ok=True)
    ca_key = ec.generate_private_key(ec.SECP256R1())
    subject = _name(f"motord authority {secrets.token_hex(4)}")
    ca = _sign(subject, subject, ca_key, ca_key, CA_DAYS, _of_authority())
    key = ec.generate_private_key(ec.SECP256R1())
    extensions = [*_of_end(Usage.SERVER_AUTH), (x509.SubjectAlternativeName(names), False)]
    server = _sign(_name("motord daemon"), subject, key, ca_key, days, extensions)
    with _all_or_none() as made:
        _write_key(folder / "ca.key", ca_key, made)
        _write(folder / "ca.pem", _pem(ca), made)
        _write_key(folder / "server.key", key, made)
        _write(folder / "server.pem", _pem(server), made)
        made.append(folder / ROLES)
        roles.write(folder / ROLES, {})


def add(folder: Path, name: str, role: Role, days: int = CERTIFICATE_DAYS) -> Path:
    """Make the certificate of a client, give it its role, return its folder.

    Raises SecurityError if the name is taken or there is no authority in `folder`.
    """
    check_name(name)
    ca, ca_key = _load(folder)
    given = roles.read(folder / ROLES)
    own = folder / CLIENTS / name
    if name in given or own.exists():  # else a certificate that was taken back would count again
        raise SecurityError(f"{name} is taken, also if it was removed; choose another name")
    key = ec.generate_private_key(ec.SECP256R1())
    certificate = _sign(_name(name), ca.subject, key, ca_key, days, _of_end(Usage.CLIENT_AUTH))
    own.mkdir(parents=True, mode=0o700)
    with _all_or_none() as made:
        made.append(own)
        _write_key(own / KEY, key, made)
        _write(own / CERTIFICATE, _pem(certificate), made)
        _write(own / CA, _pem(ca), made)
        _write(own / ABOUT, f'name = "{name}"\nrole = "{role}"\n'.encode(), made)
        roles.write(folder / ROLES, {**given, name: role})
    return own


@contextmanager
def _all_or_none() -> Iterator[list[Path]]:
    """Yield a list for files and folders that are made; remove them if not all could be."""
    made: list[Path] = []
    try:
        yield made
    except BaseException:  # an interrupt, too
        for path in reversed(made):
            if path.is_dir():
                path.rmdir()
            else:
                path.unlink(missing_ok=True)
        raise


def remove(folder: Path, name: str) -> None:
    """Take the role of a client away; its name stays taken. Raises SecurityError if it has none."""
    given = roles.read(folder / ROLES)
    if name not in given:
        raise SecurityError(f"{folder / ROLES}: there is no {name}")
    roles.write(folder / ROLES, {who: role for who, role in given.items() if who != name})
    (folder / CLIENTS / name).mkdir(parents=True, exist_ok=True)  # it may have been moved away


def ends(path: Path) -> datetime.datetime:
    """Return until when a certificate is good (UTC). Raises SecurityError."""
    try:
        return x509.load_pem_x509_certificate(path.read_bytes()).not_valid_after_utc
    except OSError as error:
        raise SecurityError(f"{path}: cannot read it: {error.strerror}") from None
    except ValueError:
        raise SecurityError(f"{path}: not a certificate (PEM)") from None


def _load(folder: Path) -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey]:
    try:
        ca = x509.load_pem_x509_certificate((folder / "ca.pem").read_bytes())
        key = serialization.load_pem_private_key((folder / "ca.key").read_bytes(), None)
    except OSError as error:
        raise SecurityError(
            f"{error.filename}: cannot read it: {error.strerror}; `motord security init {folder}` "
            "makes an authority"
        ) from None
    except ValueError:
        raise SecurityError(f"{folder}: ca.pem or ca.key is not a PEM file") from None
    except TypeError:  # as cryptography says it
        raise SecurityError(
            f"{folder / 'ca.key'}: it is encrypted; `openssl pkey` decrypts it"
        ) from None
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise SecurityError(f"{folder / 'ca.key'}: not a key made by `motord security init`")
    return ca, key


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


_Extensions = list[tuple[x509.ExtensionType, bool]]


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _of_authority() -> _Extensions:
    constraints = x509.BasicConstraints(ca=True, path_length=0)
    return [(constraints, True), (_usage(signs_certificates=True), True)]


def _of_end(usage: x509.ObjectIdentifier) -> _Extensions:
    return [
        (x509.BasicConstraints(ca=False, path_length=None), True),
        (_usage(signs_certificates=False), True),
        (x509.ExtendedKeyUsage([usage]), False),
    ]


def _sign(
    subject: x509.Name,
    issuer: x509.Name,
    key: ec.EllipticCurvePrivateKey,
    ca_key: ec.EllipticCurvePrivateKey,
    days: int,
    extensions: _Extensions,
) -> x509.Certificate:
    now = datetime.datetime.now(datetime.UTC)
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - CLOCKS_APART)
        .not_valid_after(now + datetime.timedelta(days=days))
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), False)
        .add_extension(
            x509.AuthorityKeyIdentifier.from_issuer_public_key(ca_key.public_key()), False
        )
    )
    for extension, critical in extensions:
        builder = builder.add_extension(extension, critical)
    return builder.sign(ca_key, hashes.SHA256())


def _alternative_names(hosts: Sequence[str]) -> list[x509.GeneralName]:
    names: dict[str, x509.GeneralName] = {}
    for host in hosts:
        try:
            names[host] = x509.IPAddress(ipaddress.ip_address(host))
        except ValueError:
            if not host.isascii() or not host or any(c in host for c in " /:"):
                raise SecurityError(f"'{host}' is neither a host name nor an address") from None
            names[host] = x509.DNSName(host)
    return list(names.values())


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def _write_key(path: Path, key: ec.EllipticCurvePrivateKey, made: list[Path]) -> None:
    encoded = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    _write(path, encoded, made, 0o600)


def _write(path: Path, content: bytes, made: list[Path], mode: int = 0o644) -> None:
    """Write a new file, which is added to `made`. Raises SecurityError if there is one."""
    made.append(path)
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        if isinstance(error, FileExistsError):  # of another process that makes the same
            made.remove(path)
        raise SecurityError(f"{path}: cannot make it: {error.strerror}") from None
