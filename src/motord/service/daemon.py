"""`motord run`: build the daemon, start it, run it, stop it in the opposite order."""

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
from motord.process.allocator import shrink_heaps_from_their_end
from motord.process.signal_handlers import INTERRUPTS, handled
from motord.security.roles import SecurityError
from motord.service.bench.calibrations import state_directory
from motord.service.build import Daemon, build
from motord.service.gateway import process
from motord.service.host import descriptors, scheduling
from motord.service.host.descriptors import DescriptorsError
from motord.service.host.log import log_to_stderr
from motord.service.host.systemd import Notifier
from motord.service.publish.zenoh_api import ApiError
from motord.service.supervisor import Supervisor
from motord.shm.run_directory import RunDir, RunDirError
from motord.shm.shared_records import SharedFileError
from motord.unix_clock import Clock


class LoopFailedError(Exception):
    """The loop did not come up; the message says why."""


class SupervisorFailedError(Exception):
    """The supervisor ended by an error in the program; its traceback is in the log."""


EXPLAINED = (
    ApiError,
    ConfigError,
    DescriptorsError,
    DeviceError,
    LoopFailedError,
    RunDirError,
    SecurityError,
    SharedFileError,
    SupervisorFailedError,
)
"""What may go wrong through no fault of the program: one clear line, exit 1."""


@dataclass
class StopSignal:
    """The signal that asked the daemon to ramp down and end, "" if none has."""

    name: str = ""

    def __call__(self) -> bool:
        """Return whether one came."""
        return bool(self.name)


@contextmanager
def stop_signals() -> Iterator[StopSignal]:
    """Note SIGTERM, SIGINT and SIGHUP instead of dying of them."""
    stopping = StopSignal()

    def note(number: int, _frame: FrameType | None) -> None:
        stopping.name = signal.Signals(number).name

    with handled(INTERRUPTS, note):
        yield stopping


def run(
    config_path: Path,
    on_ready: Callable[[Config], None] = lambda config: None,
    state_dir: Path | None = None,
) -> None:
    """Run the bench of `config_path` until SIGTERM or SIGINT; `on_ready` is called once it is up.

    Installed calibrations are kept under `state_dir`. Raises one of EXPLAINED, NoThreadError.
    """
    config_path = config_path.resolve()
    config, toml = config_file.load_started(config_path, kept=config_path)
    state_dir = state_dir or state_directory()
    check_names(
        *(config_path, state_dir, config.recording.directory, config.recording.blackbox_directory)
    )
    if config.zenoh.tls is not None:
        process.check(config.zenoh.tls)
    descriptors.raise_limit()
    shrink_heaps_from_their_end()
    with (
        log_to_stderr(),
        stop_signals() as stopping,
        RunDir(config.bench.name).hold() as run_dir,
        closing(Notifier.of_environment()) as notifier,
    ):
        config_file.keep(config_path, toml, run_dir.bench_file)
        daemon = build(
            config, toml, config_path, run_dir, state_dir, Clock.measure(), notifier,
        )  # fmt: skip
        with started(daemon):
            supervise(daemon.supervisor, stopping, lambda: on_ready(config))


def check_names(*paths: Path) -> None:
    """Raise ConfigError for a path whose bytes are no text: messages and recordings are UTF-8."""
    for path in paths:
        try:
            str(path.absolute()).encode()
        except UnicodeEncodeError:
            raise ConfigError(
                f"{path.absolute()}: the name is not UTF-8; rename the folder or file, or set a "
                "locale of UTF-8 if it is (LC_ALL=C.UTF-8)"
            ) from None


@contextmanager
def started(daemon: Daemon) -> Iterator[None]:
    """Open and start everything in this order; stop and close it in the opposite one."""
    gc.collect()
    gc.freeze()  # modules and compiled kernels: to look through them takes longer than a step may
    supervisor, config = daemon.supervisor, daemon.supervisor.bench.config
    with ExitStack() as stack:
        stack.callback(scheduling.restore_priority)
        scheduling.raise_priority(config.loop.priority)
        for device in supervisor.bench.devices.values():
            stack.callback(device.close)
            device.open(time.monotonic_ns())
        supervisor.step()  # so that there is a state for whoever asks at once
        stack.callback(daemon.api.close)
        daemon.api.open(config.zenoh.local, config.zenoh.socket_group)
        stack.callback(daemon.telemetry.stop)
        daemon.telemetry.start()
        stack.callback(daemon.device_threads.stop)
        stack.callback(supervisor.take_down)
        supervisor.start()
        daemon.device_threads.start()  # once the supervisor can step: its orders soon expire
        scheduling.raise_threads()
        yield


def supervise(supervisor: Supervisor, stopping: StopSignal, on_ready: Callable[[], None]) -> None:
    """Wait for the loop, step until a signal comes, ramp down. Raises one of EXPLAINED.

    An error in the program takes the current away.
    """
    bench, notifier = supervisor.bench, supervisor.notifier
    try:
        if supervisor.wait_for_loop(stopping):
            on_ready()
            notifier.ready(f"bench {bench.config.bench.name} is up, OFF")
            supervisor.run_until(stopping)
        elif not stopping():
            raise LoopFailedError(bench.loop.fault)
        notifier.stopping(f"ramping down: {stopping.name}")
        supervisor.ramp_down(stopping.name)  # requests are carried out as soon as the loop is up
    except EXPLAINED:
        raise
    except BaseException as error:  # whatever it is, the current has to go before the daemon does
        line = supervisor.emergency(error)
        notifier.stopping(line)  # else the watchdog ends it while the recording is closed
        raise SupervisorFailedError(f"{line}; stopped, the traceback is in the log") from error
