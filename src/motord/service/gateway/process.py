"""The gateway: the process that other machines reach, by TLS, and the only one.

A Zenoh router of its own. It asks every client for a certificate, lets through what the role allows
(`motord.security.access`) and passes it on to the daemon over the loopback interface. What comes
from the network and is not allowed, or is too much, ends here and holds up nothing else. It says
on its stdout, one JSON object a line, who connects, disconnects or is refused. When roles or
certificates change, all connections end and come back under the new ones; when its stdin ends, it
ends.
"""

import os
import select
import signal
import threading
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import IO

import zenoh

from motord import config as config_file
from motord.api.endpoints import gateway_config
from motord.config import Config, ConfigError
from motord.config.zenoh import TlsConfig
from motord.process.bench_options import bench_options
from motord.process.ending_threads import NoThreadError, ends_in_time, start_thread
from motord.process.left_threads import end_process, end_with_any_thread
from motord.recorder.pipe_lines import LineWriter
from motord.recording.json_encoding import to_line
from motord.security import roles as roles_file
from motord.security.identity import check_files
from motord.security.roles import SecurityError
from motord.service.gateway.audit import LEVELS, AuditLog, Throttle
from motord.service.gateway.link import DATA_MAX, MESSAGE_MAX
from motord.shm.run_directory import RunDir

STDIN = 0
BACKLOG_MAX_BYTES = 1 << 20
LOOK_S = 1.0
"""How often it looks whether roles or certificates have changed, and shows that it goes on."""

Signature = tuple[tuple[int, int, int], ...]


class AuditReporter:
    """Writes lines of JSON for the supervisor, from any thread; never waits for it."""

    def __init__(self, out: LineWriter) -> None:
        self._out = out
        self._lock = threading.Lock()
        self._throttle = Throttle()
        self._lost = 0

    def report(self, message: str, **data: str) -> None:
        """Report what happened to the supervisor."""
        with self._lock:
            allowed = self._throttle.pass_on(message, time.monotonic_ns())
            if allowed is not None:
                self._write(allowed, data)
            if self._out.dropped > self._lost:
                lost, self._lost = self._out.dropped - self._lost, self._out.dropped
                self._write(f"{lost} messages about access were lost: the daemon did not take them")

    def show_alive(self) -> None:
        """Write what the supervisor did not take before, then a message that says nothing."""
        with self._lock:
            self._out.flush()
            if not self._out.waiting:
                self._write("")

    def _write(self, message: str, data: Mapping[str, str] | None = None) -> None:
        short = {key: value[:DATA_MAX] for key, value in (data or {}).items()}
        self._out.write(to_line({"message": message[:MESSAGE_MAX], "data": short}))


def take_over_stdout() -> tuple[IO[str], IO[bytes]]:
    """Let what Zenoh logs to stdout arrive here; return (Zenoh's log, the real stdout)."""
    out = os.fdopen(os.dup(1), "wb", 0)
    reader, writer = os.pipe()
    os.dup2(writer, 1)
    os.close(writer)
    return os.fdopen(reader, errors="replace"), out


def listen_to(log: IO[str], audit: AuditLog, reporter: AuditReporter) -> None:
    """Pass on what Zenoh's log says about refusals, until it ends."""
    for line in log:
        refused = audit.read(line)
        if refused is not None:
            reporter.report(refused.message, **refused.data)


def report_link(event: zenoh.LinkEvent, audit: AuditLog, reporter: AuditReporter) -> None:
    """Report who connects and who disconnects."""
    link = event.link
    if not link.src.startswith("tls/"):
        return
    name, where = link.auth_identifier or "somebody", link.dst.removeprefix("tls/")
    role = audit.roles.get(name, "")
    if event.kind == zenoh.SampleKind.DELETE:
        audit.names.pop(str(link.zid), None)
        reporter.report(f"{name} at {where} has disconnected", who=name, where=where)
        return
    audit.names[str(link.zid)] = name
    message = f"{name} ({role}) has connected from {where}"
    if not role:
        message = f"{name} has connected from {where}, but has no role here and may do nothing"
    reporter.report(message, who=name, role=role, where=where)


def signature(tls: TlsConfig) -> Signature:
    """Return what changes when one of the files changes."""
    found = []
    for path in (tls.ca, tls.certificate, tls.key, tls.roles):
        try:
            status = path.stat()
        except OSError:
            found.append((0, 0, 0))
        else:
            found.append((status.st_mtime_ns, status.st_size, status.st_ino))
    return tuple(found)


def check(tls: TlsConfig) -> dict[str, roles_file.Role]:
    """Return the roles if the files of access can be used. Raises SecurityError."""
    check_files(tls.ca, tls.certificate, tls.key)
    return roles_file.read(tls.roles)


def _until_changed_or_ended(
    tls: TlsConfig, before: Signature, meanwhile: Callable[[], None]
) -> bool:
    """Wait until a file has changed (True) or stdin has ended (False)."""
    while True:
        meanwhile()
        readable, _, _ = select.select([STDIN], [], [], LOOK_S)
        if readable and not os.read(STDIN, 1024):
            return False
        if signature(tls) != before:
            return True


def keep(config: Config, reporter: AuditReporter, log: IO[str]) -> None:
    """Let clients in until stdin ends. Raises SecurityError, zenoh.ZError."""
    assert config.zenoh.tls is not None
    audit = AuditLog({})
    start_thread(partial(listen_to, log, audit, reporter), "motord-gateway-log")
    zenoh.init_log_from_env_or(LEVELS)
    while _keep_unchanged(config, config.zenoh.tls, audit, reporter):
        continue


def _keep_unchanged(
    config: Config, tls: TlsConfig, audit: AuditLog, reporter: AuditReporter
) -> bool:
    """Let clients in under the files as they are; return whether these have changed.

    Raises SecurityError if a client holds up that all connections end.
    """
    before = signature(tls)
    roles = check(tls)
    audit.roles = {name: str(role) for name, role in roles.items()}
    session = zenoh.open(gateway_config(config, roles))
    listener = session.info.declare_link_events_listener(
        lambda event: report_link(event, audit, reporter), history=True
    )
    reporter.report(f"open to other machines at {', '.join(config.zenoh.remote)}, {_count(roles)}")
    changed = _until_changed_or_ended(tls, before, reporter.show_alive)
    if changed:
        reporter.report("roles or certificates have changed; all clients have to connect again")
    listener.undeclare()  # type: ignore[no-untyped-call]
    _close(session)
    return changed


def _close(session: zenoh.Session) -> None:
    if not ends_in_time(session.close, "motord-gateway-close"):  # or all others stay out as long
        raise SecurityError("a client that takes nothing holds up the end of all connections")


def _count(roles: dict[str, roles_file.Role]) -> str:
    counts = [f"{list(roles.values()).count(role)} {role}s" for role in roles_file.Role]
    return f"for {' and '.join(counts)}"


def main() -> int:
    """Run the gateway of the bench file that `--config` names."""
    options = bench_options("gateway").parse_args()
    end_with_any_thread()
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.environ.pop("RUST_LOG", None)
    log, out = take_over_stdout()
    os.set_blocking(out.fileno(), False)
    reporter = AuditReporter(LineWriter(out.fileno(), BACKLOG_MAX_BYTES))
    try:
        kept = RunDir.at(options.dir).bench_file
        config, _ = config_file.load_started(options.config, kept, plans=False)
        keep(config, reporter, log)
    except (ConfigError, NoThreadError, SecurityError, zenoh.ZError) as error:
        reporter.report(f"closed to other machines: {str(error).split(' at /')[0]}")
        return 1
    return 0


if __name__ == "__main__":
    end_process(main())
