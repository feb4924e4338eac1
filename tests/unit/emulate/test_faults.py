"""Faults of the emulator: wires, the order of things, commands; without processes."""

import json
import socket
import stat
from pathlib import Path

import pytest
from typer.testing import CliRunner

from motord.cli import app
from motord.config import ConfigError, load
from motord.config.faults import KINDS, Fault, Timeline
from motord.emulate import EmulatorError
from motord.emulate.bench import EmulatedBench
from motord.emulate.board import Board
from motord.emulate.control import ControlSocket, control_path, inject
from motord.emulate.devices import NEVER_NS
from motord.emulate.disturbance import Disturbance
from motord.emulate.faults import Injector
from motord.rig.truth import RigTruth
from motord.schema import FAULT_COUNT_SHIFT, BridgeStatus, InverterStatus
from motord.wire.bridge import frames
from tests.support.random_faults import random_timeline
from tests.unit.emulate.benches import EMULATED

MS = 1_000_000


@pytest.fixture
def config():
    return load(EMULATED)


@pytest.fixture
def injected(config):
    return Injected(config)


class Injected:
    """A bench with an injector, and what it reported and asked for."""

    def __init__(self, config):
        self.bench = EmulatedBench(config, RigTruth(), 0)
        self.can, self.bridge = Disturbance(), Disturbance()
        self.reported, self.stalls, self.restarts = [], [], []
        self.injector = Injector(
            self.bench, self.can, self.bridge, lambda *report: self.reported.append(report),
            self.stalls.append, lambda: self.restarts.append(self.bench.now_ns),
        )  # fmt: skip

    def play(self, now_ns):
        self.injector.play(now_ns)
        self.bench.advance(now_ns, lambda _frame: None)


def test_a_wire_without_faults_passes_everything_at_once():
    wire = Disturbance()
    assert wire.to_host(0, "a", b"abc") == [b"abc"]
    assert wire.to_device(b"abc") == b"abc"
    assert wire.next_ns == NEVER_NS


def test_lost_changed_and_doubled():
    wire = Disturbance()
    wire.drop = 1.0
    assert wire.to_host(0, "a", b"abc") == []
    assert wire.to_device(b"abc") is None
    wire.clear()
    wire.corrupt = 1.0
    [changed] = wire.to_host(0, "a", b"abc")
    assert sum((x ^ y).bit_count() for x, y in zip(changed, b"abc", strict=True)) == 1
    assert wire.to_device(b"") == b""
    wire.clear()
    wire.duplicate = 1.0
    assert wire.to_host(0, "a", b"abc") == [b"abc", b"abc"]
    wire.clear()
    wire.off = True
    assert wire.to_host(0, "a", b"abc") == []
    assert wire.to_device(b"abc") is None


def test_fractions_are_fractions():
    wire = Disturbance(seed=3)
    wire.drop = 0.3
    passed = sum(len(wire.to_host(0, "a", b"x")) for _ in range(2000))
    assert 1300 < passed < 1500


def test_late_frames_keep_their_order_and_come_when_they_are_due():
    wire = Disturbance()
    wire.delay_ns = 10 * MS
    assert wire.to_host(0, "a", b"1") == []
    assert wire.to_host(MS, "b", b"2") == []
    assert wire.next_ns == 10 * MS
    assert list(wire.due(9 * MS)) == []
    assert list(wire.due(10 * MS)) == [("a", b"1")]
    wire.clear()
    assert wire.to_host(10 * MS, "c", b"3") == []  # must not overtake
    assert list(wire.due(11 * MS)) == [("b", b"2"), ("c", b"3")]
    assert wire.to_host(12 * MS, "d", b"4") == [b"4"]


@pytest.mark.parametrize(
    ("kind", "wire", "field"),
    [
        ("can_drop", "can", "drop"), ("can_corrupt", "can", "corrupt"),
        ("can_duplicate", "can", "duplicate"), ("can_late", "can", "delay_ns"),
        ("can_bus_off", "can", "off"), ("bridge_drop", "bridge", "drop"),
        ("bridge_reboot", "bridge", "off"),
    ],
)  # fmt: skip
def test_a_fault_of_a_wire_is_put_and_taken_away(injected, kind, wire, field):
    injected.injector.add(Fault(kind=kind, at_s=0.001, for_s=0.002), 0)
    assert injected.injector.next_ns == MS
    disturbed = getattr(injected, wire)
    injected.play(0)
    assert not disturbed.active
    injected.play(MS)
    assert disturbed.active
    assert getattr(disturbed, field)
    injected.play(3 * MS)
    assert not disturbed.active
    assert not getattr(disturbed, field)
    assert [(at_ns, event["kind"], event["fault"]) for at_ns, event in injected.reported] == [
        (MS, kind, 1)
    ]


def test_faults_of_the_rig_show_in_what_the_inverter_says(injected):
    injected.injector.add(Fault(kind="inverter_fault", for_s=0.01), 0)
    injected.play(0)
    injected.bench.advance(2 * MS, lambda _frame: None)
    assert injected.bench.inverter_status(injected.bench.sense()) & InverterStatus.FAULT
    injected.play(11 * MS)
    injected.bench.advance(12 * MS, lambda _frame: None)
    assert not injected.bench.inverter_status(injected.bench.sense()) & InverterStatus.FAULT


def test_brake_host_and_board(injected):
    add = injected.injector.add
    add(Fault(kind="brake_silent", for_s=0.01), 0)
    add(Fault(kind="host_stall", for_s=0.05), 0)
    add(Fault(kind="bridge_clock", jump_s=0.5), 0)
    add(Fault(kind="bridge_reboot", at_s=0.002, for_s=0.003), 0)
    board = injected.bench.board
    before_us = board.clock_us(0)
    injected.play(0)
    assert injected.bench.brake.silent
    assert injected.stalls == [0.05]
    assert board.clock_us(0) - before_us == pytest.approx(500_000, abs=50)
    board.streaming = board.line_closed = True
    injected.play(2 * MS)
    assert not board.streaming
    assert not board.line_closed
    assert injected.restarts == []
    injected.play(5 * MS)
    assert len(injected.restarts) == 1
    injected.play(10 * MS)
    assert not injected.bench.brake.silent


def test_the_board_counts_faults_in_its_status(config):
    board = Board(config, 0)
    board.faults_begun = 3
    sample = board.sample(0, 1, 2, True)
    assert sample.status >> FAULT_COUNT_SHIFT == 3
    assert sample.status & 0xFF == BridgeStatus.TORQUE_INVALID
    board.faults_begun = 130
    assert board.status(0).status >> FAULT_COUNT_SHIFT == 2


def test_a_board_that_starts_anew_forgets(config):
    board = Board(config, 0)
    board.receive(MS, frames.Numbered(0, frames.Start()))
    board.receive(MS, frames.Numbered(1, frames.Heartbeat(0)))
    board.receive(MS, frames.Numbered(2, frames.Heartbeat(1)))
    assert board.line_closed
    board.restart(5 * MS)
    assert not board.line_closed
    assert board.status(5 * MS).heartbeats == 0
    board.receive(6 * MS, frames.Numbered(3, frames.Heartbeat(1)))  # of a host that has not noticed
    assert not board.line_closed
    assert board.clock_us(5 * MS) == Board(config, 0).clock_us(0)


@pytest.mark.parametrize("seed", range(20))
def test_random_timelines_end_as_they_began(injected, seed):
    timeline = random_timeline(seed, 0.05, "emulate")
    for fault in timeline.fault:
        injected.injector.add(fault, 0)
    for now_ns in range(0, 4_000 * MS, 50 * MS):
        injected.play(now_ns)
    assert injected.injector.next_ns == NEVER_NS
    assert not injected.can.active
    assert not injected.bridge.active
    assert not injected.bench.rig_input["injected"]["active"].any()
    assert injected.injector.begun == len(timeline.fault) == len(injected.reported)


def test_faults_that_cannot_be_here(injected):
    with pytest.raises(ConfigError, match="supervisor_silent is not possible here"):
        Timeline(fault=(Fault(kind="supervisor_silent"),)).check_place("emulate")
    with pytest.raises(ValueError, match="not possible here"):
        injected.injector.add(Fault(kind="supervisor_silent"), 0)


def test_every_kind_but_the_supervisors_is_for_the_emulator():
    assert {kind for kind in KINDS if "emulate" not in KINDS[kind].places} == {"supervisor_silent"}


def test_commands(tmp_path):
    path = tmp_path / "emulator"
    served = ControlSocket(path)
    try:
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert served.receive() is None
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ours:
            ours.bind("")
            ours.settimeout(5.0)
            for request, expected in (
                (b'{"kind": "can_drop"}', Fault(kind="can_drop")),
                (b"{", "not JSON"),
                (b"\xff", "not JSON"),
                (b"[" * 60_000, "not JSON"),
                (b"[]", "Input should be a valid dictionary or instance of Fault, got []"),
                (b'{"kind": 3}', "kind: Input should be a valid string, got 3"),
                (b'{"kind": "can_drop", "x": 1}', "x: is not known"),
            ):
                ours.sendto(request, str(path))
                got, sender = served.receive()
                assert got == expected
            served.respond(sender, {"ok": True})
            assert json.loads(ours.recv(1000)) == {"ok": True}
        served.respond(sender, {"ok": True})  # nobody listens any more
    finally:
        served.close()
    assert not path.exists()


def test_a_place_where_no_socket_can_be(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(EmulatorError, match="cannot listen for commands"):
        ControlSocket(tmp_path / "file" / "emulator")


def test_nobody_else_can_listen_in_its_place(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    path = control_path(load(EMULATED))
    path.parent.mkdir(mode=0o755)
    served = ControlSocket(path)
    try:
        assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    finally:
        served.close()
    path.parent.rmdir()
    path.parent.symlink_to(tmp_path)
    with pytest.raises(EmulatorError, match="belongs to another user or is no folder"):
        ControlSocket(path)
    with pytest.raises(EmulatorError, match="belongs to another user or is no folder"):
        inject(load(EMULATED), {"kind": "can_drop"})


def test_a_bench_that_is_not_emulated_has_no_socket():
    with pytest.raises(EmulatorError, match="is not emulated"):
        control_path(load())
    assert control_path(load(EMULATED)).name.startswith("emulator-")


def test_nobody_listens(tmp_path):
    data = load(EMULATED).model_dump()
    data["bridge"]["port"] = str(tmp_path / "bridge")
    with pytest.raises(EmulatorError, match="no emulator of this bench listens"):
        inject(type(load()).model_validate(data), {"kind": "can_drop"})


def test_examples_are_for_the_emulator():
    from motord.config.faults import load_timeline

    for path in sorted((Path(EMULATED).parent / "faults").glob("*.toml")):
        load_timeline(path).check_place("emulate")


def test_kinds_are_listed():
    said = CliRunner().invoke(app, ["fault", "kinds"])
    assert said.exit_code == 0
    assert len(said.stdout.splitlines()) == len(KINDS)
    assert "[fraction=1.0]" in said.stdout
    listed = json.loads(CliRunner().invoke(app, ["fault", "kinds", "--json"]).stdout)
    assert listed["index_slip"]["parameters"] == {"counts": 300}


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["can_drop", "fraction"], "'fraction' is not NAME=VALUE"),
        (["can_drop"], "is not emulated: [bridge] has no port"),
    ],
)
def test_a_fault_that_cannot_be_sent(arguments, says, capfd):
    said = CliRunner().invoke(app, ["fault", "inject", *arguments])
    assert said.exit_code == 1
    assert says in said.output + capfd.readouterr().err


def test_a_bench_file_names_its_timeline_from_its_own_folder(tmp_path):
    text = EMULATED.read_text().replace("[bench]\n", '[bench]\nfaults = "t.toml"\n', 1)
    (tmp_path / "bench.toml").write_text(text)
    assert load(tmp_path / "bench.toml").bench.faults == tmp_path / "t.toml"
