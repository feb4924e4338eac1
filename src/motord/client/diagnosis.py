"""Diagnosis of a failed connection: Zenoh gives no reason."""

import grp
import os
import re
import socket
import ssl
from pathlib import Path

from motord.api.endpoints import UNIX_SOCKET
from motord.security.identity import Identity

CONNECT_S = 3.0
_ENDPOINT = re.compile(r"tls/(?:\[(?P<six>[^\]]+)\]|(?P<host>[^:]+)):(?P<port>\d+)(?:[?#].*)?")
_FORM = re.compile(
    r"(?:tcp|tls)/[^/,]+:\d{1,5}(?:[?#].*)?|(?:udp|quic|ws|serial|unixpipe|vsock|unixsock-stream)/.+"
)
_ALERTS = (
    ("CERTIFICATE_REQUIRED", "it asks for a certificate"),
    ("UNKNOWN_CA", "the certificate is from another authority"),
    ("DECRYPT_ERROR", "the certificate is from another authority"),
    ("CERTIFICATE_UNKNOWN", "the certificate is not accepted"),
    ("CERTIFICATE_EXPIRED", "the certificate has expired"),
    ("BAD_CERTIFICATE", "the certificate is not accepted"),
)


def why_no_endpoint(endpoint: str) -> str:
    """Return what is wrong with the form of an endpoint, "" if it is one."""
    if _FORM.fullmatch(endpoint):
        return ""
    forms = f"tcp/HOST:PORT, tls/HOST:PORT and {UNIX_SOCKET}/PATH"
    return f"'{endpoint}' is no endpoint; those are {forms}"


def why_no_socket(endpoint: str) -> str:
    """Return why a Unix socket cannot be connected to by this user, "" if that is not why."""
    if not endpoint.startswith(UNIX_SOCKET):
        return ""
    path = Path(endpoint.removeprefix(UNIX_SOCKET))
    nearest = next((p for p in (path, *path.parents) if os.path.lexists(p)), path)
    if os.access(nearest, os.W_OK if nearest == path else os.X_OK):
        return ""
    gid = nearest.stat().st_gid
    try:
        group = grp.getgrgid(gid).gr_name
    except KeyError:
        group = str(gid)
    return f"{nearest} is for members of the group {group} only"


def why_closed(endpoint: str, who: Identity) -> str:
    """Return why a handshake with `endpoint` fails, "" if there is no listener or it succeeds."""
    where = _ENDPOINT.fullmatch(endpoint)
    if where is None:
        return "expected tls/HOST:PORT"
    host = where["six"] or where["host"]
    context = ssl.create_default_context(cafile=str(who.ca))
    context.load_cert_chain(who.certificate, who.key)
    try:
        with (
            socket.create_connection((host, int(where["port"])), CONNECT_S) as plain,
            context.wrap_socket(plain, server_hostname=host) as secure,
        ):
            secure.recv(1)  # a refusal of the certificate comes after the handshake
    except ssl.SSLCertVerificationError as error:
        return f"its own certificate is not accepted here: {error.verify_message}"
    except ssl.SSLError as error:
        alert = error.reason or str(error)
        return next((meaning for sign, meaning in _ALERTS if sign in alert), alert)
    except OSError:
        return ""
    return ""
