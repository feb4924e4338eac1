"""The real `motord emulate` process, spoken to with the daemon's drivers."""

import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from motord.cli import app
from motord.config import Config, load
from motord.control.types import COMMAND, FEEDBACK
from motord.hal.registry import make_rig, make_setpoint_device
from motord.recording.reader import open_run
from motord.schema import BridgeStatus, InverterStatus
from tests.support.patience import PATIENCE_S
from tests.support.stalls import FORGIVEN
from tests.unit.emulate.benches import write_bench

pytestmark = pytest.mark.system

COMPILE_S = 120.0
"""The first emulator after a change of the rig compiles it."""
MS = 1_000_000
CURRENTS = (5.0, -2.5, -2.5)
OFF_A = 2.0
"""More than the offsets of the rig's current sensors."""


class Emulator:
    """A running `motord emulate`."""

    def __init__(self, bench: Path, *options: str) -> None:
        command = [sys.executable, "-m", "motord", "emulate", "-c", str(bench), *options]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=0
        )
        self.first_line = ""

    def read_line(self) -> None:
        """Wait for the first line of stdout, or its end."""
        assert self.process.stdout is not None
        line = b""
        deadline_s = time.monotonic() + COMPILE_S
        while not line.endswith(b"\n"):
            left_s = deadline_s - time.monotonic()
            ready, _, _ = select.select([self.process.stdout], [], [], max(left_s, 0))
            assert ready, f"no line within {COMPILE_S} s, only {line!r}"
            piece = os.read(self.process.stdout.fileno(), 1)
            if not piece:
                break
            line += piece
        self.first_line = line.decode()

    def end(self, number: signal.Signals = signal.SIGTERM) -> tuple[int, str, str]:
        """Send a signal; return exit code, the rest of stdout, and stderr."""
        self.process.send_signal(number)
        out, err = self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode, out.decode(), err.decode()


@pytest.fixture(scope="module")
def start():
    running = []

    def begin(bench: Path, *options: str) -> Emulator:
        running.append(Emulator(bench, *options))
        running[-1].read_line()
        return running[-1]

    yield begin
    for emulator in running:
        if emulator.process.poll() is None:
            emulator.process.kill()
        emulator.process.communicate(timeout=PATIENCE_S)


@pytest.fixture(scope="module")
def bench(start, tmp_path_factory):
    """Return a bench whose devices several tests use; they end with no error."""
    path = write_bench(tmp_path_factory.mktemp("shared"))
    emulator = start(path)
    assert emulator.first_line.startswith("ready: bench emulated, inverter on CAN udp_multicast")
    yield path
    assert emulator.end()[::2] == (0, "")


def flows(feedback: np.record) -> bool:
    ready = bool(feedback.inverter_status & InverterStatus.READY)
    return ready and np.allclose(feedback.i_A, CURRENTS, atol=0.5)


def lost(feedback: np.record) -> bool:
    return bool(
        feedback.inverter_status & InverterStatus.COMMAND_TIMEOUT
        or feedback.bridge_status & BridgeStatus.HEARTBEAT_LOST
    )


class Host:
    """The daemon's drivers, and a tick of about 1 ms.

    Currents, voltages, status of the inverter and of the board are messages of their own: what a
    test asks of several of them it asks of the one reading that `until` returns.
    """

    def __init__(self, bench: Path) -> None:
        config = load(bench)
        timeout_s = min(config.inverter.timeout_s, config.bridge.heartbeat_timeout_s)
        self.timeout_ns = round(timeout_s * 1e9)
        self.silent_ns = 0  # the longest time without a command or heartbeat
        self.rig = make_rig(config)
        self.feedback = np.zeros(1, FEEDBACK)
        self.command = np.zeros(1, COMMAND)
        self.commands, self.beats = True, True
        self.sent_ns = (0, 0)  # just before and just after the last command
        self.beat_ns = (0, 0)
        self.rig.open()

    def tick(self) -> np.record:
        self.rig.read(time.time_ns(), self.feedback)
        if self.commands:
            before_ns = time.time_ns()
            self.rig._inverter.write(self.command)
            self.silent_ns = max(self.silent_ns, time.time_ns() - (self.sent_ns[0] or before_ns))
            self.sent_ns = (before_ns, time.time_ns())
        if self.beats:
            before_ns = time.time_ns()
            self.rig._bridge.write(self.command)
            self.silent_ns = max(self.silent_ns, time.time_ns() - (self.beat_ns[0] or before_ns))
            self.beat_ns = (before_ns, time.time_ns())
        time.sleep(0.001)
        return self.feedback.copy()[0]

    def until(self, condition) -> np.record:
        """Tick until `condition(feedback)`; fails after PATIENCE_S."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not condition(feedback := self.tick()):
            assert time.monotonic() < deadline_s, f"still {feedback}"
        return feedback

    def switch_on(self, condition: Callable[[np.record], bool] = flows) -> np.record:
        """Disable first, as devices want after a silence; then enable with current.

        Return the first reading that fulfils `condition`. A computer so busy that this process was
        itself silent for a timeout costs another try.
        """
        while True:
            self.sent_ns = self.beat_ns = (0, 0)
            self.silent_ns = 0
            self.command["enable"], self.command["i_A"] = 0, 0.0
            self.until(lambda f: not f.inverter_status & InverterStatus.ENABLE_LINE and not lost(f))
            self.command["enable"], self.command["i_A"] = 1, CURRENTS
            feedback = self.until(lambda f: condition(f) or lost(f))
            if condition(feedback):
                return feedback
            silent = f"switch_on: lost after a silence of {self.silent_ns * 1e-9:.2f} s"
            assert self.silent_ns >= self.timeout_ns, silent
            FORGIVEN.append(silent)


@pytest.fixture
def host():
    hosts = []

    def connect(bench: Path) -> Host:
        hosts.append(Host(bench))
        return hosts[-1]

    yield connect
    for connected in hosts:
        connected.rig.close()


def switched_off(truth: np.ndarray, field: str, on_at_ns: int) -> int:
    """Return the time of the first row from `on_at_ns` on with `field` 0.

    How late that is, the computer decides here; in virtual time `test_bench` of the emulator does.
    """
    later = truth[truth["t_ns"] > on_at_ns]
    return int(later["t_ns"][later[field] == 0][0])


def test_currents_come_by_commands_and_go_in_silence_and_the_end_is_clean(start, host, tmp_path):
    patient = {"heartbeat_timeout_s = 1.0": "heartbeat_timeout_s = 0.5"}
    bench, truth = write_bench(tmp_path, patient), tmp_path / "truth.mcap"
    emulator = start(bench, "--json", "--truth", str(truth))
    ready = json.loads(emulator.first_line)
    assert ready["ready"] is True
    assert Path(ready["bridge"]).is_symlink()
    daemon = host(bench)
    currents_flow(daemon)
    bus_ns = silence_on_the_bus(daemon)
    heartbeat_ns = silence_of_heartbeats(daemon)
    stall(emulator, daemon)
    daemon.rig.close()
    code, out, err = emulator.end(signal.SIGINT)
    assert (code, err) == (0, "")
    summary = json.loads(out)
    assert summary["ticks_on"] > 0
    assert summary["heartbeat_drops"] > 0
    assert summary["skipped"] > 100
    assert not Path(ready["bridge"]).is_symlink()
    rows = open_run(truth).truth()
    assert 0 < len(rows) == summary["truth_rows"] <= summary["ticks"]
    on = rows["inverter_on"] == 1
    assert summary["torque_mean_Nm"] == pytest.approx(float(rows["torque_Nm"][on].mean()), rel=1e-4)
    assert np.median(np.diff(rows["t_ns"])) == pytest.approx(MS, abs=2000)
    config = load(bench)
    for field, silent_ns, timeout_s in (
        ("inverter_on", bus_ns, config.inverter.timeout_s),
        ("enable_line", heartbeat_ns, config.bridge.heartbeat_timeout_s),
    ):
        assert switched_off(rows, field, silent_ns) >= silent_ns + round(timeout_s * 1e9) - MS


def currents_flow(daemon):
    feedback = daemon.switch_on(
        lambda f: (
            flows(f)
            and f.bridge_status == BridgeStatus.ENABLE_LINE
            and f.inverter_status == InverterStatus.READY | InverterStatus.ENABLE_LINE
            and abs(f.u_bus_V - 24.0) < 0.5
        )
    )
    assert feedback.t_ns == pytest.approx(time.time_ns(), abs=PATIENCE_S * 1e9)
    assert feedback.t_inverter_ns == pytest.approx(time.time_ns(), abs=PATIENCE_S * 1e9)


def silence_on_the_bus(daemon):
    """Send no commands until the currents are zero, then switch on; return since when (ns)."""
    daemon.commands = False
    daemon.until(
        lambda f: (
            np.abs(f.i_A).max() < OFF_A
            and f.inverter_status & InverterStatus.COMMAND_TIMEOUT
            and not f.inverter_status & InverterStatus.READY
        )
    )
    before_ns, _ = daemon.sent_ns
    daemon.commands = True
    daemon.switch_on()
    return before_ns


def silence_of_heartbeats(daemon):
    """Send none until the enable line is open, then switch on; return since when (ns)."""
    daemon.beats = False
    daemon.until(
        lambda f: (
            f.bridge_status == BridgeStatus.HEARTBEAT_LOST
            and not f.inverter_status & InverterStatus.ENABLE_LINE
            and np.abs(f.i_A).max() < OFF_A
        )
    )
    before_ns, _ = daemon.beat_ns
    daemon.beats = True
    daemon.switch_on()
    return before_ns


def stall(emulator, daemon):
    """Stop the emulator for a while; then it can be switched on."""
    emulator.process.send_signal(signal.SIGSTOP)
    stopped = daemon.until(lambda f: f.now_ns - f.t_inverter_ns > 600 * MS)
    stale_ns = int(stopped.t_inverter_ns)
    emulator.process.send_signal(signal.SIGCONT)
    daemon.until(lambda f: f.t_inverter_ns > stale_ns + 600 * MS)
    daemon.switch_on()


def _patient(path: Path) -> Config:
    """Return a bench whose devices may be late, as no daemon's drive may be."""
    bench = load(path)
    for section in (bench.brake, bench.drive):
        assert section.modbus is not None
        section.__dict__["modbus"] = section.modbus.model_copy(update={"timeout_s": 5.0})
    return bench


@pytest.fixture
def slow_devices():
    """Return a maker of the bench's brake and drive, opened; they are closed at the end."""
    with ExitStack() as opened:

        def make(bench: Path):
            devices = [make_setpoint_device(kind, _patient(bench)) for kind in ("brake", "drive")]
            for device in devices:
                opened.callback(device.close)
                device.open()
            return devices

        yield make


def test_brake_and_drive_answer_and_move_the_rig(bench, host, slow_devices):
    brake, drive = slow_devices(bench)
    assert brake.exchange(0.5).setpoint == pytest.approx(0.5)
    assert brake.exchange(0.5).value == pytest.approx(25.0, abs=5.0)
    daemon = host(bench)
    at_rest = daemon.until(lambda f: f.t_ns > 0).encoder_gray
    deadline_s = time.monotonic() + PATIENCE_S
    while drive.exchange(2.0).value < 1.9:
        assert time.monotonic() < deadline_s
        daemon.tick()
    daemon.until(lambda f: f.encoder_gray != at_rest)
    drive.safe_stop()
    assert drive.exchange(0.0).setpoint == 0.0


def test_the_bridge_samples_at_the_rate_that_the_host_asks_for(bench, host, tmp_path):
    faster = tmp_path / "faster.toml"
    faster.write_text(bench.read_text().replace("[bridge]\n", "[bridge]\nrate_Hz = 2000\n"))
    daemon = host(faster)  # opening checks the rate that the board reports
    daemon.switch_on()
    first_ns = int(daemon.tick().t_ns)
    daemon.until(lambda f: f.t_ns > first_ns)


def test_a_second_emulator_of_a_bench_is_refused_in_one_line(bench, start):
    second = start(bench)
    code, out, err = second.end()
    assert (second.first_line, out, code) == ("", "", 1)
    assert "is another emulator running?" in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({'interface = "udp_multicast"': 'interface = "socketcan"'}, "CAN socketcan"),
        ({'driver = "can"': 'driver = "acme"'}, '[inverter] driver = "acme"'),
        ({'dbc = "package:inverter.dbc"': 'dbc = "nowhere.dbc"'}, "nowhere.dbc"),
        ({'rig = "package:report.rig.toml"': 'rig = "nowhere.toml"'}, "nowhere.toml"),
    ],
)
def test_what_cannot_be_served_is_one_line(tmp_path, changes, expected):
    result = CliRunner().invoke(app, ["emulate", "-c", str(write_bench(tmp_path, changes))])
    assert result.exit_code == 1
    assert expected in result.stderr
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "bridge").is_symlink()


def test_it_ends_by_itself_after_the_time_asked_for(start, tmp_path):
    emulator = start(write_bench(tmp_path), "--duration-s", "0.2")
    out, err = emulator.process.communicate(timeout=COMPILE_S)
    assert (emulator.process.returncode, err) == (0, b"")
    assert out.startswith(b"ended: ")
    assert b"never switched on" in out
