"""Counts the files on the path of a set-point, and the modules that an analysis imports.

    python tools/count_imports.py [--calibrate RUN...] [--cogging RUN...]

A file is on the path if one of its functions is given the set-point, or the payload or record that
carries it, on the way from `motord set --torque-Nm 3` to the CAN frame. Each row of `PATH` is
checked: the function exists, and its module is imported by that of a row before, unless the row
names what carries the set-point across.
"""

import argparse
import ast
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

PACKAGE = Path(__file__).resolve().parents[1] / "src" / "motord"
FILES_MAX = 25
ESTIMATOR = "motord.experiments.calibration.estimate."


class Step(NamedTuple):
    """A function on the path; `across`: what carries the set-point to it, "" for an import."""

    file: str
    function: str
    does: str
    across: str = ""


PATH = (
    Step("cli/bench/operate.py", "set_", "reads the options"),
    Step(
        "client/connection.py",
        "DaemonConnection.ask",
        "encodes JSON, sends the query",
        "connection",
    ),
    Step("service/publish/zenoh_api.py", "Api._declare", "receives the query", "Zenoh"),
    Step("service/rpc/intake.py", "Intake.accept", "checks the size, paces"),
    Step("service/rpc/outstanding.py", "OutstandingQueries.admit", "bounds what is outstanding"),
    Step("service/bench/lease.py", "CommandLease.is_in", "finds the token", "callback in_command"),
    Step("api/requests.py", "parse", "decodes a SetpointChange: types, finite numbers"),
    Step("service/rpc/dispatcher.py", "CallQueue.put", "queues it for the supervisor"),
    Step("service/supervisor.py", "Supervisor.step", "takes the queue, steps", "thread"),
    Step("service/rpc/dispatcher.py", "Dispatcher.handle", "requires the lease, preconditions"),
    Step("service/rpc/operation.py", "ManualOperation.set_point", "carries it out", "handlers"),
    Step("service/rpc/preconditions.py", "validate_setpoint", "validates it as a whole"),
    Step("sequencing/limits.py", "check_torque", "compares it with [limits]"),
    Step("service/bench/manual_control.py", "ManualControl.set", "leads with the brake"),
    Step("service/setpoint.py", "Setpoint.write", "fills the SETPOINT record"),
    Step("service/bench/bench.py", "Bench.step", "writes it a hundred times a second"),
    Step("shm/mailbox.py", "MailboxWriter.write", "shares it"),
    Step("loop/control_loop.py", "run", "reads it in every tick", "shared memory"),
    Step("loop/tick_kernel.py", "run_tick", "passes the records to the kernel"),
    Step("control/step.py", "step", "ramps, compensates, limits"),
    Step("control/reference.py", "clamp", "clamps it"),
    Step("hal/wire_rig.py", "WireRig.write", "passes the COMMAND record on", "protocol Rig"),
    Step("hal/inverter/can_drive.py", "CanInverter.write", "takes the currents", "registry"),
    Step("hal/inverter/can_drive.py", "CanDrive._send", "sends the payload"),
    Step("wire/can/codec.py", "InverterCodec.encode_command", "encodes them", "dbc.load"),
    Step("hal/can/socketcan.py", "SocketCan.send", "sends the frame", "protocol CanBus"),
)
"""From the command line to the frame of a drive that takes phase currents."""

RUNNER = """
import atexit, json, sys
from motord.cli import main

def write_modules():
    modules = sorted(name for name in sys.modules if name.split(".")[0] == "motord")
    open(sys.argv[-1] + ".modules", "w").write(json.dumps(modules))

atexit.register(write_modules)
main()
"""
"""A command of motord that writes what it has imported; `main` ends the process (`os._exit`)."""


def imports(file: str) -> set[str]:
    """Return the modules that a file of the package imports anywhere, also inside functions."""
    found = set()
    for node in ast.walk(ast.parse((PACKAGE / file).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def functions(file: str) -> Iterator[str]:
    """Yield the functions and methods of a file, methods with their class."""
    for node in ast.parse((PACKAGE / file).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef):
            yield node.name
        elif isinstance(node, ast.ClassDef):
            yield from (
                f"{node.name}.{n.name}" for n in node.body if isinstance(n, ast.FunctionDef)
            )


def path_errors(path: Sequence[Step] = PATH) -> list[str]:
    """Return what is wrong with a path: functions that are not there, links that do not exist."""
    errors, reached = [], {path[0].file}
    known: set[str] = set()
    for step in path:
        if step.function not in functions(step.file):
            errors.append(f"{step.file}: no function {step.function}")
        module = "motord." + step.file.removesuffix(".py").replace("/", ".")
        if step.file not in reached and not step.across and module not in known:
            errors.append(f"{step.file}: not imported by a file before it")
        reached.add(step.file)
        known |= imports(step.file)
    return errors


def imported_modules(kind: str, runs: Sequence[str]) -> list[str]:
    """Return the modules of motord that `motord analyse KIND RUN...` has imported at its end."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "result.json"
        command = [sys.executable, "-c", RUNNER, "analyse", kind, *runs, "-o", str(out)]
        environment = {**os.environ, "PYTHONPATH": str(PACKAGE.parent)}
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
        modules: list[str] = json.loads(Path(f"{out}.modules").read_text(encoding="utf-8"))
    return modules


def main() -> int:
    """Print the path and the counts; 1 if the path is wrong or too long."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calibrate", nargs="+", metavar="RUN", help="recordings of a mesh")
    parser.add_argument("--cogging", nargs="+", metavar="RUN", help="recordings of a slow turn")
    options = parser.parse_args()
    out = sys.stdout
    for step in PATH:
        across = f"  ({step.across})" if step.across else ""
        out.write(f"{step.file:36} {step.function:28} {step.does}{across}\n")
    files, errors = len({step.file for step in PATH}), path_errors()
    out.write(f"files from the command line to the frame: {files}, at most {FILES_MAX}\n")
    out.writelines(f"{error}\n" for error in errors)
    for kind, runs in (("calibrate", options.calibrate), ("cogging", options.cogging)):
        if runs:
            modules = imported_modules(kind, runs)
            estimator = [m for m in modules if m.startswith(ESTIMATOR)]
            out.write(f"analyse {kind}: {len(modules)} modules of motord; of the calibration ")
            out.write(f"estimator {', '.join(estimator) or 'none'}\n")
    return 1 if errors or files > FILES_MAX else 0


if __name__ == "__main__":
    sys.exit(main())
