"""`motord run`: builds all parts of the daemon, runs them, takes them down in order."""

import gc
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from motord import config as config_file
from motord.config import Config, ConfigError
from motord.hal.base import DeviceError
from motord.security.error import SecurityError
from motord.service.assembly import Assembly, assemble
from motord.service.bench.calibrations import state_directory
from motord.service.gateway import process
from motord.service.host import descriptors, scheduling
from motord.service.host.log import log_to_stderr
from motord.service.host.systemd import Notifier
from motord.service.publish.zenoh_api import ApiError
from motord.service.supervisor import Supervisor
from motord.shm.run_directory import RunDir, RunDirError
from motord.shm.shared_records import SharedFileError
from motord.shm.unix_clock import Clock


class LoopFailedError(Exception):
    """The loop did not come up; the message says why."""


class SupervisorFailedError(Exception):
    """The supervisor ended by an error in the program; its traceback is in the log."""


EXPLAINED = (
    ApiError,
    ConfigError,
    DeviceError,
    LoopFailedError,
    RunDirError,
    SecurityError,
    SharedFileError,
    SupervisorFailedError,
)
"""What may go wrong through no fault of the program: one clear line, exit 1."""


@dataclass
class Stopping:
    """Set by a signal: the daemon ramps down and ends."""

    reason: str = ""

    def __call__(self) -> bool:
        """Return whether a signal came."""
        return bool(self.reason)


@contextmanager
def stop_signals() -> Iterator[Stopping]:
    """Note SIGTERM, SIGINT and SIGHUP instead of dying of them."""
    stopping = Stopping()

    def note(number: int, _frame: FrameType | None) -> None:
        stopping.reason = signal.Signals(number).name

    noted = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
    before = {number: signal.signal(number, note) for number in noted}
    try:
        yield stopping
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def run(
    config_path: Path,
    on_ready: Callable[[Config], None] = lambda config: None,
    state_dir: Path | None = None,
) -> None:
    """Run the bench of `config_path` until SIGTERM or SIGINT; `on_ready` is called once it is up.

    Installed calibrations are kept under `state_dir`. Raises one of EXPLAINED.
    """
    config = config_file.load(config_path)
    text = config_path.read_text(encoding="utf-8")
    if config.zenoh.tls is not None:
        process.check(config.zenoh.tls)
    descriptors.raise_limit()
    with ExitStack() as stack:
        stack.enter_context(log_to_stderr())
        stopping = stack.enter_context(stop_signals())
        run_dir = stack.enter_context(RunDir(config.bench.name).hold())
        notifier = stack.enter_context(closing(Notifier.of_environment()))
        daemon = assemble(
            config, text, config_path.resolve(), run_dir, state_dir or state_directory(),
            Clock.measure(),
        )  # fmt: skip
        daemon.supervisor.notifier = notifier
        _run(daemon, stack, stopping, lambda: on_ready(config))


def _run(
    daemon: Assembly, stack: ExitStack, stopping: Stopping, on_ready: Callable[[], None]
) -> None:
    """Bring everything up in order, run, take it down in the opposite order."""
    gc.collect()
    gc.freeze()  # modules and compiled kernels: to look through them takes longer than a step may
    supervisor, config = daemon.supervisor, daemon.supervisor.bench.config
    stack.callback(scheduling.fall)
    scheduling.rise(config.loop.priority)
    for device in daemon.devices.values():
        stack.callback(device.close)
        device.open(time.monotonic_ns())
    supervisor.step()  # so that there is a state for whoever asks at once
    stack.callback(daemon.api.close)
    daemon.api.open(config.zenoh.local, config.zenoh.socket_group)
    stack.callback(daemon.telemetry.stop)
    daemon.telemetry.start()
    stack.callback(daemon.device_threads.stop)
    daemon.device_threads.start()
    stack.callback(supervisor.take_down)
    if supervisor.gate is not None:
        supervisor.gate.start(time.monotonic_ns())
    supervisor.recording.recorder.start(time.monotonic_ns())
    supervisor.loop.start(time.monotonic_ns())
    scheduling.lift_threads()
    _guarded(supervisor, stopping, on_ready)


def _guarded(supervisor: Supervisor, stopping: Stopping, on_ready: Callable[[], None]) -> None:
    """As `_supervise`; an error in the program takes the current away. Raises one of EXPLAINED."""
    try:
        _supervise(supervisor, stopping, on_ready)
    except EXPLAINED:
        raise
    except Exception as error:  # whatever it is, the current has to go before the daemon does
        said = supervisor.emergency(error)
        raise SupervisorFailedError(f"{said}; stopped, the traceback is in the log") from error


def _supervise(supervisor: Supervisor, stopping: Stopping, on_ready: Callable[[], None]) -> None:
    """Wait for the loop, step until a signal comes, ramp down. Raises LoopFailedError."""
    if not supervisor.wait_for_loop(stopping):
        if stopping():
            return
        raise LoopFailedError(supervisor.bench.loop_fault)
    on_ready()
    config = supervisor.bench.config
    supervisor.notifier.ready(f"bench {config.bench.name} is up, OFF")
    supervisor.run(stopping)
    supervisor.notifier.stopping(f"ramping down: {stopping.reason}")
    supervisor.ramp_down(stopping.reason)
