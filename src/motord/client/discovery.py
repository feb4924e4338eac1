"""Finding the daemon behind an endpoint, and why it cannot be reached: Zenoh gives no reason."""

import grp
import os
import re
import socket
import ssl
from pathlib import Path

import zenoh

from motord import DEFAULT_ENDPOINT
from motord.api.endpoints import KEY_ROOT, UNIX_SOCKET, client_config, key
from motord.client.client import Client
from motord.client.connection import QUERY_S
from motord.client.error import ClientError
from motord.process.ending_threads import ends_in_time
from motord.security import identity as identity_folder
from motord.security.identity import Identity
from motord.security.roles import SecurityError

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
NAMESAKES_S = 0.5
"""How long it is waited for further daemons of one name: a daemon that hangs answers to none."""


def connect(
    bench: str | None = None,
    endpoint: str | None = None,
    identity: Identity | Path | str | None = None,
) -> Client:
    """Connect to the daemon of `bench` at `endpoint`; without a name, to the only one there.

    From another machine: `endpoint` "tls/HOST:7448" and `identity`, the folder that
    `motord security add` made. What is not given comes from the environment, as for the command
    line: MOTORD_CONNECT (else DEFAULT_ENDPOINT) and MOTORD_IDENTITY. Raises ClientError if there is
    no daemon or it does not let this one in.
    """
    endpoint = endpoint or os.environ.get("MOTORD_CONNECT") or DEFAULT_ENDPOINT
    who = identity_for(endpoint, identity or os.environ.get("MOTORD_IDENTITY") or None)
    session = open_session(endpoint, who, bench)
    try:
        return Client(session, _find_bench(session, bench, endpoint, who), endpoint, who)
    except (ClientError, zenoh.ZError) as error:  # Zenoh's own if it is cut off meanwhile
        ends_in_time(session.close, "motord-close")
        if isinstance(error, ClientError):
            raise
        raise _unreachable(bench, endpoint, who) from None


def open_session(
    endpoint: str, who: Identity | None = None, bench: str | None = None
) -> zenoh.Session:
    """Return a session with whoever listens at an endpoint. Raises ClientError if nobody does."""
    try:
        return zenoh.open(client_config(endpoint, who))
    except zenoh.ZError:
        raise _unreachable(bench, endpoint, who) from None


def identity_for(endpoint: str, given: Identity | Path | str | None) -> Identity | None:
    """Return the identity to show at an endpoint, None where none is asked for.

    Raises ClientError "forbidden" if there is none for a TLS endpoint, or it cannot be read.
    """
    if endpoint.startswith("tls/") and given is None:
        raise ClientError(
            "forbidden", f"{endpoint} asks for a certificate: say which identity to show"
        )
    if given is None or not endpoint.startswith("tls/"):
        return None
    try:
        return given if isinstance(given, Identity) else identity_folder.load(Path(given))
    except SecurityError as error:
        raise ClientError("forbidden", str(error)) from None


def _unreachable(bench: str | None, endpoint: str, who: Identity | None = None) -> ClientError:
    if who is not None and (refused := why_closed(endpoint, who)):
        return ClientError("forbidden", f"{endpoint} does not let {who.name} in: {refused}")
    if malformed := why_no_endpoint(endpoint):
        return ClientError("unreachable", malformed)
    if forbidden := why_no_socket(endpoint):
        return ClientError("forbidden", forbidden)
    which = f" for bench '{bench}'" if bench else ""
    return ClientError(
        "unreachable", f"no motord at {endpoint}{which}: is `motord run` running there?"
    )


def _find_bench(
    session: zenoh.Session, bench: str | None, endpoint: str, who: Identity | None
) -> str:
    """Return the bench whose daemon is alive behind the endpoint. Raises ClientError."""
    tokens = session.liveliness().get(f"{KEY_ROOT}/*/alive", timeout=QUERY_S)
    benches = sorted({str(t.ok.key_expr).split("/")[1] for t in tokens if t.ok is not None})
    if bench in benches or (bench is None and len(benches) == 1):
        found = bench or benches[0]
        _refuse_namesakes(session, found, endpoint)
        return found
    if not benches and who is not None:
        raise ClientError(
            "forbidden", f"{endpoint} shows nothing to {who.name}: no role there, or no bench"
        )
    if not benches:
        raise _unreachable(bench, endpoint)
    there = ", ".join(benches)
    if bench is None:
        raise ClientError("unreachable", f"several benches at {endpoint}: {there}; name one")
    raise ClientError(
        "unreachable", f"no motord at {endpoint} for bench '{bench}'; there is one for: {there}"
    )


def _refuse_namesakes(session: zenoh.Session, bench: str, endpoint: str) -> None:
    """Raise ClientError if two daemons have one name: Zenoh would pass requests on to either."""
    replies = session.get(
        key(bench, "state"),
        target=zenoh.QueryTarget.ALL,
        consolidation=zenoh.ConsolidationMode.NONE,
        timeout=NAMESAKES_S,
    )
    daemons = {str(r.replier_id.zid) for r in replies if r.ok is not None and r.replier_id}
    if len(daemons) > 1:
        raise ClientError(
            "refused",
            f"{len(daemons)} daemons at {endpoint} have the name '{bench}': nobody knows which of "
            "them a request would reach. Connect to one of them by its own endpoint, and give each "
            "a [bench] name of its own",
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
