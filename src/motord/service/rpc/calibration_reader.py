"""Reads calibrations, of a request and on disk, in a process of its own.

Parsing megabytes in the supervisor would delay its heartbeat. Input and output are pickled: both
ends of the pipe are this module.
"""

import math
import os
import pickle
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from motord.api.errors import RpcError
from motord.api.replies import CalibrationDetails, Interval
from motord.api.requests import (
    CALIBRATION_INSTALL,
    max_request_bytes,
    parse,
)
from motord.calibration import Calibration, CalibrationError, format_duration, load
from motord.config import MotorConfig
from motord.process.ending_threads import why_not_started
from motord.process.left_threads import end_process
from motord.process.module_command import module_command
from motord.service.bench.calibrations import check_given

CURVE_MAX = 2048
"""Values of the cogging torque over a turn; of more counts every so many-th one is given."""

READ_S = 30.0
"""Reading takes a second or two, most of it to start the process."""

FILES_S = 20.0
"""Files on disk that are not read by then are left for the next request."""

MEMORY_BYTES = 1024**3
"""For the process and what it makes of the longest calibration, several times over."""


def details(calibration: Calibration, path: Path) -> CalibrationDetails:
    """Return what is in a calibration, which is not known to be in force."""
    c, content = calibration, calibration.to_json()
    stride = math.ceil(c.motor.counts / CURVE_MAX)
    shown = range(0, c.motor.counts, stride)
    rms = content["rms_error_percent"]
    derived = {
        "created": c.created.isoformat(),
        "age_s": 0.0,
        "age": "",
        "in_force": False,
        "path": str(path),
        "alpha_95": _intervals(c.alpha, c.alpha_half_width),
        "degrees_of_freedom": content.get("degrees_of_freedom"),
        "beta_95_A": _intervals(c.beta_A, c.beta_half_width_A),
        "findings": content.get("findings", []),
        "learned": c.learned is not None,
        "rms_error_percent": {name: rms[name] for name in ("before", "after")},
        "tau_cog_half_widths_Nm": [h.half_width_Nm for h in c.tau_cog_harmonics],
        "angle_rad": [2 * math.pi * count / c.motor.counts for count in shown],
        "tau_cog_Nm": [c.tau_cog_Nm[count] for count in shown],
    }
    as_in_the_file = {n: content[n] for n in CalibrationDetails.model_fields if n in content}
    return CalibrationDetails(**{**as_in_the_file, **derived})


def aged(found: CalibrationDetails, in_force: str) -> CalibrationDetails:
    """Return the same now: how old it is, and whether it is the one `in_force`."""
    age_s = (datetime.now(UTC) - datetime.fromisoformat(found.created)).total_seconds()
    now = {"age_s": age_s, "age": format_duration(age_s), "in_force": found.id == in_force}
    return found.model_copy(update=now)


def _intervals(values: tuple[float, ...], half_widths: tuple[float, ...]) -> list[Interval]:
    return [[value - half, value + half] for value, half in zip(values, half_widths, strict=True)]


Read = Callable[[bytes, MotorConfig], tuple[str, Calibration]]
"""Returns token and calibration of a request to install one. Raises RpcError."""
ReadFiles = Callable[[Sequence[Path]], dict[Path, CalibrationDetails | str]]
"""Returns what is in each file, or why that cannot be read, as far as there is time. Raises
RpcError."""


def read(payload: bytes, motor: MotorConfig) -> tuple[str, Calibration]:
    """Read a request to install a calibration, here and now."""
    request = parse(CALIBRATION_INSTALL, payload, max_request_bytes(motor.counts))
    try:
        calibration = check_given(motor, request.calibration, request.path)
    except CalibrationError as error:
        raise RpcError("invalid", str(error)) from None
    _check_accepted(calibration, request.accept)
    return request.token, calibration


def _check_accepted(calibration: Calibration, accepted: Collection[str]) -> None:
    """Raise RpcError, which says what to type, unless all serious findings are `accepted`."""
    serious = calibration.serious_findings
    missing = [one.figure() for one in serious if one.name not in accepted]
    if missing:
        raise RpcError(
            "refused",
            f"calibration {calibration.id} has {len(missing)} serious "
            f"finding{'s' * (len(missing) > 1)}: {'; '.join(missing)}. `motord calibration show "
            "FILE` says what that means and what to do; to apply it all the same: `motord "
            f"calibration install FILE {calibration.accept_options}`",
        )


def read_files(paths: Sequence[Path]) -> dict[Path, CalibrationDetails | str]:
    """Read calibration files, here and now, for `FILES_S` at most and one in any case."""
    end_s, found = time.monotonic() + FILES_S, dict[Path, CalibrationDetails | str]()
    for path in paths:
        try:
            found[path] = details(load(path), path)
        except CalibrationError as error:
            found[path] = str(error)
        if time.monotonic() > end_s:
            break
    return found


def read_elsewhere(payload: bytes, motor: MotorConfig) -> tuple[str, Calibration]:
    """Read a request in a process of its own, which ends with it; for a thread that may wait."""
    token, calibration = _elsewhere("request", payload, motor)
    return token, calibration


def read_files_elsewhere(paths: Sequence[Path]) -> dict[Path, CalibrationDetails | str]:
    """Read files in a process of its own, which ends with it; for a thread that may wait."""
    found: dict[Path, CalibrationDetails | str] = _elsewhere("files", paths)
    return found


_TASKS: dict[str, Callable[..., Any]] = {"request": read, "files": read_files}


def _elsewhere(task: Literal["request", "files"], *arguments: Any) -> Any:
    command = module_command("motord.service.rpc.calibration_reader")
    try:
        done = subprocess.run(
            command,
            input=pickle.dumps((task, arguments)),
            stdout=subprocess.PIPE,
            timeout=READ_S,
            check=True,
        )
        outcome = pickle.loads(done.stdout)
    except subprocess.TimeoutExpired:
        raise RpcError("timeout", f"the calibration was not read in {READ_S:g} s") from None
    except OSError as error:
        why = f"no process could read the calibration: {why_not_started(error)}"
        raise RpcError("failed", why) from None
    except subprocess.CalledProcessError as error:
        raise RpcError("failed", f"no process could read the calibration: {error}") from None
    if isinstance(outcome, RpcError):
        raise outcome
    return outcome


def main() -> int:
    """Read what comes on stdin, write what it is to stdout, both pickled.

    At the priority of ordinary programs, also when a thread whose priority was raised started it:
    at the lowest, a computer that is busy with others would not get it done in READ_S.
    """
    os.nice(max(0, -os.getpriority(os.PRIO_PROCESS, 0)))
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY_BYTES, MEMORY_BYTES))
    task, arguments = pickle.load(sys.stdin.buffer)
    outcome: Any
    try:
        outcome = _TASKS[task](*arguments)
    except RpcError as error:
        outcome = error
    except MemoryError:
        outcome = RpcError("invalid", "the calibration takes too much memory to read")
    pickle.dump(outcome, sys.stdout.buffer)
    return 0


if __name__ == "__main__":
    end_process(main())
