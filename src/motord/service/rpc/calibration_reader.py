"""Reads the calibration of a request in a process of its own.

Parsing megabytes in the supervisor would delay its heartbeat. Input and output are pickled: both
ends of the pipe are this module.
"""

import os
import pickle
import resource
import subprocess
import sys
from collections.abc import Callable

from motord.api.errors import RpcError
from motord.api.requests import (
    CALIBRATION_INSTALL,
    max_request_bytes,
    parse,
)
from motord.calibration import Calibration, CalibrationError
from motord.config import MotorConfig
from motord.service.bench.calibrations import check_given

READ_S = 30.0
"""Reading takes a second or two, most of it to start the process."""
MEMORY_BYTES = 1024**3
"""For the process and what it makes of the longest calibration, several times over."""
Read = Callable[[bytes, MotorConfig], tuple[str, Calibration]]
"""Returns token and calibration of a request to install one. Raises RpcError."""


def read(payload: bytes, motor: MotorConfig) -> tuple[str, Calibration]:
    """Read a request to install a calibration, here and now."""
    request = parse(CALIBRATION_INSTALL, payload, max_request_bytes(motor.counts))
    try:
        return request.token, check_given(motor, request.calibration, request.path)
    except CalibrationError as error:
        raise RpcError("invalid", str(error)) from None


def read_elsewhere(payload: bytes, motor: MotorConfig) -> tuple[str, Calibration]:
    """Read a request in a process of its own, which ends with it; for a thread that may wait."""
    command = (sys.executable, "-m", "motord.service.rpc.calibration_reader")
    try:
        done = subprocess.run(
            command,
            input=pickle.dumps((payload, motor)),
            stdout=subprocess.PIPE,
            timeout=READ_S,
            check=True,
        )
        outcome = pickle.loads(done.stdout)
    except subprocess.TimeoutExpired:
        raise RpcError("timeout", f"the calibration was not read in {READ_S:g} s") from None
    except (OSError, subprocess.CalledProcessError) as error:
        raise RpcError("failed", f"no process could read the calibration: {error}") from None
    if isinstance(outcome, RpcError):
        raise outcome
    token, calibration = outcome
    return token, calibration


def main() -> int:
    """Read what comes on stdin, write what it is to stdout, both pickled.

    At the priority of ordinary programs, also when a thread whose priority was raised started it:
    at the lowest, a computer that is busy with others would not get it done in READ_S.
    """
    os.nice(max(0, -os.getpriority(os.PRIO_PROCESS, 0)))
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY_BYTES, MEMORY_BYTES))
    payload, motor = pickle.load(sys.stdin.buffer)
    outcome: RpcError | tuple[str, Calibration]
    try:
        outcome = read(payload, motor)
    except RpcError as error:
        outcome = error
    except MemoryError:
        outcome = RpcError("invalid", "calibration/install: takes too much memory to read")
    pickle.dump(outcome, sys.stdout.buffer)
    return 0


if __name__ == "__main__":
    sys.exit(main())
