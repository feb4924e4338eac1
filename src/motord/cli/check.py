"""`motord check`: is this bench file right, do its devices answer, is there real time."""

import errno
import grp
import os
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord.cli.common_options import AsJson, BenchFile
from motord.cli.console import explain_first_run, fail, print_result

if TYPE_CHECKING:
    from motord.config import ChannelConfig, Config
    from motord.config.zenoh import ZenohConfig
    from motord.hal.channel_source import ChannelSource

LOOK_S = 0.02
IN_USE = "in use: by a daemon that runs, or another program"
Finding = dict[str, Any]


def check(
    config: BenchFile = None,
    rt: Annotated[
        bool,
        typer.Option(
            "--rt",
            help="Say which real-time rights it would get, and what of the machine is in the way.",
        ),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Check a bench file, probe devices, endpoints and the folder of recordings.

    Nothing is enabled or set.
    """
    from motord.config import load
    from motord.config.rules.check_notes import false_trips, hidden_faults

    bench = load(config)
    explain_first_run(silent=as_json)
    findings: list[Finding] = [
        {"what": "config", "ok": True, "message": f"bench {bench.bench.name}"}
    ]
    findings += [*probe_devices(bench), probe_endpoints(bench), probe_recordings(bench)]
    notes = [
        *hidden_faults(bench), *false_trips(bench), *_rig_notes(bench), *_plan_notes(bench)
    ]  # fmt: skip
    rights, host = _realtime(bench) if rt else ([], [])
    lines = [f"{f['what']}: {'ok, ' if f['ok'] else ''}{f['message']}" for f in findings]
    lines += [f"note: {note}" for note in notes]
    lines += [f"real time: {right['line']}" for right in rights]
    lines += [f"{'host' if f['good'] else 'host, could be better'}: {f['line']}" for f in host]
    result = {"findings": findings, "notes": notes, "realtime": rights, "host": host}
    print_result(result, "\n".join(lines), as_json)
    wrong = [finding["what"] for finding in findings if not finding["ok"]]
    if wrong:
        fail(f"not ready to run: {', '.join(wrong)}")


def probe_devices(bench: "Config") -> list[Finding]:
    """Open each device, read it once, close it. A bench that is in use is left alone."""
    from motord.hal.channels.registry import make_lines
    from motord.shm.run_directory import RunDir, RunDirError

    channels = [one for line in make_lines(bench) for one in line]
    try:
        with RunDir(bench.bench.name).hold():
            return [
                _probe("inverter and bridge", lambda: _probe_rig(bench)),
                _probe("brake", lambda: _probe_slow("brake", bench)),
                _probe("drive", lambda: _probe_slow("drive", bench)),
                *(_probe(f"channel {c.name}", partial(_probe_channel, c, s)) for c, s in channels),
            ]
    except RunDirError as error:
        return [{"what": "devices", "ok": False, "message": str(error)}]


def probe_endpoints(bench: "Config") -> Finding:
    """Listen where the daemon would, for a moment; read who is let in."""
    listen = bench.zenoh.listen
    refused = [f"{endpoint}: {why}" for endpoint in listen if (why := _cannot_listen(endpoint))]
    refused += _access_problems(bench.zenoh)
    message = "; ".join(refused) or ", ".join(listen)
    return {"what": "endpoints", "ok": not refused, "message": message}


def _cannot_listen(endpoint: str) -> str:
    """Return why nobody can listen at a Zenoh endpoint, "" if one can."""
    from motord.service.host.unix_socket import SocketError, check_place

    protocol, _, address = endpoint.partition("/")
    if protocol == "unixsock-stream":
        path = Path(address)
        try:
            check_place(path)
        except SocketError as error:
            return str(error)
        if not os.access(path.parent, os.W_OK):
            return f"{path.parent} may not be written"
        return _socket_obstacle(path)
    host, _, port = address.rpartition(":")
    family = socket.AF_INET6 if host.startswith("[") else socket.AF_INET
    try:
        socket.create_server((host.strip("[]"), int(port)), family=family).close()
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            return IN_USE
        return error.strerror or str(error)
    return ""


def _socket_obstacle(path: Path) -> str:
    """Return why no Unix socket can be made, "" if it can: one that nobody serves is replaced."""
    with socket.socket(socket.AF_UNIX) as probe:
        probe.setblocking(False)
        try:
            probe.connect(str(path))
        except (ConnectionRefusedError, FileNotFoundError):
            return ""
        except BlockingIOError:
            pass  # somebody serves it, and has too much to do
        except OSError as error:
            return error.strerror or str(error)
    return IN_USE


def _access_problems(zenoh: "ZenohConfig") -> Iterator[str]:
    """Yield why the daemon could let nobody in: no such group, certificates or roles."""
    if zenoh.socket_group is not None:
        try:
            grp.getgrnam(zenoh.socket_group)
        except KeyError:
            yield f"socket_group = '{zenoh.socket_group}': there is no such group"
    if zenoh.tls is not None:
        from motord.security.roles import SecurityError
        from motord.service.gateway.process import check as check_access

        try:
            check_access(zenoh.tls)
        except SecurityError as error:
            yield str(error)


def probe_recordings(bench: "Config") -> Finding:
    """Write to the folder of recordings as the recorder would, and look at its free space."""
    from motord.recording.storage import free_bytes, obstacle

    folder = bench.recording.directory.absolute()
    made = [one for one in (folder, *folder.parents) if not os.path.lexists(one)]
    why = obstacle(bench.recording)
    message = why or f"{folder}, {free_bytes(folder) / 1e9:.1f} GB free"
    for one in made:
        with suppress(OSError):
            one.rmdir()
    return {"what": "recordings", "ok": not why, "message": message}


def _rig_notes(bench: "Config") -> Iterator[str]:
    """Yield what is wrong with the rig file, which a bench needs that is emulated."""
    from motord.config import ConfigError
    from motord.rig.truth import load

    if bench.bench.rig is not None and not bench.simulated:  # else the rig is made of it
        try:
            load(bench.bench.rig)
        except ConfigError as error:
            yield from error.after("motord emulate cannot be this bench: ").lines


def _plan_notes(bench: "Config") -> Iterator[str]:
    """Yield which plans of the bench file cannot be started with the settings that it has."""
    from motord.experiments.plans import build
    from motord.sequencing import PlanError

    for field in sorted(bench.plans.model_fields_set):
        name = field.replace("_", "-")
        try:
            build(name, bench)
        except PlanError as error:
            yield f"[plans.{name}] cannot be started as it stands: {error}"


def _probe(what: str, probe: Callable[[], str]) -> Finding:
    from motord.config import ConfigError
    from motord.hal.base import DeviceError

    try:
        return {"what": what, "ok": True, "message": probe()}
    except (DeviceError, ConfigError) as error:
        return {"what": what, "ok": False, "message": str(error)}


def _probe_rig(bench: "Config") -> str:
    import numpy as np

    from motord.api.descriptions import bridge_action
    from motord.control.types import FEEDBACK
    from motord.hal.base import DeviceError
    from motord.hal.registry import make_rig
    from motord.schema import BridgeStatus, InverterStatus

    rig, feedback = make_rig(bench), np.zeros(1, FEEDBACK)
    try:
        rig.open()
        rig.read(time.time_ns(), feedback)
    finally:
        rig.close()
    inverter = InverterStatus(int(feedback["inverter_status"][0]))
    bridge = BridgeStatus(int(feedback["bridge_status"][0]))
    if wrong := bridge_action(bridge):
        raise DeviceError(wrong)
    return (
        f"{bench.inverter.driver} and {bench.bridge.driver}: bus {feedback['u_bus_V'][0]:.1f} V, "
        f"inverter {_flags(inverter)}, bridge {_flags(bridge)}"
    )


def _flags(status: Any) -> str:
    return "|".join(flag.name for flag in type(status) if flag & status) or "off"


def _probe_slow(kind: Any, bench: "Config") -> str:
    from motord.hal.registry import make_setpoint_device

    section = bench.brake if kind == "brake" else bench.drive
    if section.driver in ("none", "sim"):
        return "none" if section.driver == "none" or not bench.simulated else "simulated"
    device = make_setpoint_device(kind, bench)
    try:
        device.open()
    finally:
        device.close()
    return f"{section.driver}: answers"


def _probe_channel(channel: "ChannelConfig", source: "ChannelSource") -> str:
    """Return what a slow channel reads; waits for it as long as the daemon would."""
    from motord.hal.base import DeviceError
    from motord.hal.channel_source import ChannelReading
    from motord.service.bench.channels import Channel

    judged, end_s = Channel(channel), time.monotonic() + channel.timeout_s
    try:
        with closing(source):
            source.open()
            while (sample := source.read()) is None and time.monotonic() < end_s:
                time.sleep(LOOK_S)
    except DeviceError:
        raise
    except Exception as error:  # of a driver of another package
        raise DeviceError(f"error in its driver: {type(error).__name__}: {error}") from error
    if sample is None:
        raise DeviceError(f"nothing came within timeout_s = {channel.timeout_s:g}")
    now_ns = time.monotonic_ns()
    judged.take(ChannelReading(channel.name, now_ns, sample.value))
    if obstacle := judged.obstacle(now_ns):
        raise DeviceError(obstacle)
    return f"{channel.source.driver}: {judged.value:.6g} {channel.unit}, {judged.status(now_ns)}"


def _realtime(bench: "Config") -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the real-time rights that there would be, and what is found about the host."""
    from motord.loop.rt_diagnostics import findings
    from motord.loop.rt_setup import probe

    rights = [{**item.model_dump(), "line": item.line()} for item in probe(bench.loop).items]
    host = [{**found.model_dump(), "line": found.line()} for found in findings(bench.loop.cpu)]
    return rights, host
