"""`motord check`: is this bench file right, do its devices answer, is there real time."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord.cli.common_options import AsJson, BenchFile
from motord.cli.console import explain_first_run, fail, print_result

if TYPE_CHECKING:
    from motord.config import Config

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
    """Check a bench file, probe each device and where recordings go; nothing is enabled or set."""
    from motord.config import load

    bench = load(config)
    explain_first_run(silent=as_json)
    findings: list[Finding] = [
        {"what": "config", "ok": True, "message": f"bench {bench.bench.name}"}
    ]
    findings += [*probe_devices(bench), probe_recordings(bench)]
    rights, host = _realtime(bench) if rt else ([], [])
    lines = [f"{f['what']}: {'ok, ' if f['ok'] else ''}{f['message']}" for f in findings]
    lines += [f"real time: {right['line']}" for right in rights]
    lines += [f"{'host' if f['good'] else 'host, could be better'}: {f['line']}" for f in host]
    result = {"findings": findings, "realtime": rights, "host": host}
    print_result(result, "\n".join(lines), as_json)
    wrong = [finding["what"] for finding in findings if not finding["ok"]]
    if wrong:
        fail(f"not ready to run: {', '.join(wrong)}")


def probe_devices(bench: "Config") -> list[Finding]:
    """Open each device, read it once, close it. A bench that is in use is left alone."""
    from motord.shm.run_directory import RunDir, RunDirError

    try:
        with RunDir(bench.bench.name).hold():
            return [
                _probe("inverter and bridge", lambda: _probe_rig(bench)),
                _probe("brake", lambda: _probe_slow("brake", bench)),
                _probe("drive", lambda: _probe_slow("drive", bench)),
            ]
    except RunDirError as error:
        return [{"what": "devices", "ok": False, "message": str(error)}]


def probe_recordings(bench: "Config") -> Finding:
    """Write to the folder of recordings as the recorder would, and look at its free space."""
    from contextlib import suppress

    from motord.recording.storage import free_bytes, obstacle

    folder = bench.recording.directory.absolute()
    was_there = folder.exists()
    why = obstacle(bench.recording)
    if why:
        return {"what": "recordings", "ok": False, "message": why}
    free_GB = free_bytes(folder) / 1e9
    if not was_there:
        with suppress(OSError):
            folder.rmdir()
    return {"what": "recordings", "ok": True, "message": f"{folder}, {free_GB:.1f} GB free"}


def _probe(what: str, probe: Callable[[], str]) -> Finding:
    from motord.config import ConfigError
    from motord.hal.base import DeviceError

    try:
        return {"what": what, "ok": True, "message": probe()}
    except (DeviceError, ConfigError) as error:
        return {"what": what, "ok": False, "message": str(error)}


def _probe_rig(bench: "Config") -> str:
    import time

    import numpy as np

    from motord.control.types import FEEDBACK
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


def _realtime(bench: "Config") -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the real-time rights that there would be, and what is found about the host."""
    from motord.loop.rt_diagnostics import findings
    from motord.loop.rt_setup import probe

    rights = [{**item.model_dump(), "line": item.line()} for item in probe(bench.loop).items]
    host = [{**found.model_dump(), "line": found.line()} for found in findings(bench.loop.cpu)]
    return rights, host
