"""The enable line against a model of its own: every short history, many long ones, any found."""

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from motord.wire.bridge import frames
from tests.firmware import line_model
from tests.firmware.device import CLOCK, Device
from tests.firmware.library import Library
from tests.firmware.line_model import LineModel
from tests.support.properties import examples

TICK_US = 500


def test_every_history_of_three_events(library: Library) -> None:
    ffi, lib = library.ffi, library.lib
    for start_us in (0, CLOCK - line_model.TIMEOUT_US):
        for steps in line_model.all_short(3):
            assert line_model.play(ffi, lib, start_us, steps) is None


def test_long_histories(library: Library) -> None:
    assert line_model.check(library.ffi, library.lib, 1, 10_000) is None


class Line(RuleBasedStateMachine):
    """The whole board, over its link: heartbeats, Stop, silence, hellos; the line is the pin."""

    library: Library
    link = 0

    @initialize(start_us=st.sampled_from([0, 12_345, CLOCK - 40_000, CLOCK - 1]))
    def boot(self, start_us: int) -> None:
        self.device = Device(self.library, self.link, start_us)
        self.model = LineModel(50_000)
        self.lost_seen = False

    def send(self, kind: str, frame: frames.Frame) -> None:
        self.device.send(frame)
        self.model.event(kind, self.device.now_us)

    @rule(enable=st.sampled_from([0, 1, 1, 1]))
    def beat(self, enable: int) -> None:
        self.send(f"beat {enable}", frames.Heartbeat(enable))

    @rule()
    def stop(self) -> None:
        self.send("stop", frames.Stop())

    @rule()
    def start(self) -> None:
        self.device.send(frames.Start())

    @rule(protocol=st.sampled_from([frames.PROTOCOL, frames.PROTOCOL, 1, 3, 0, 0xFFFF]))
    def hello(self, protocol: int) -> None:
        self.send("permit" if protocol == frames.PROTOCOL else "bar", frames.HelloRequest(protocol))

    @rule(timeout_us=st.sampled_from([999, 1000, 1001, 20_000, 50_000, 1_000_000, 1_000_001]))
    def configure(self, timeout_us: int) -> None:
        self.device.send(frames.Configure(1000, timeout_us))
        if 1000 <= timeout_us <= 1_000_000:
            self.model.event("stop", self.device.now_us)
            self.model.timeout_us = timeout_us

    @rule(noise=st.binary(max_size=40))
    def garbage(self, noise: bytes) -> None:
        if not self.link:
            self.device.receive(noise + b"\0")

    @rule(ticks=st.integers(1, 200), late_us=st.integers(0, 400))
    def let_pass(self, ticks: int, late_us: int) -> None:
        for _ in range(ticks):
            self.device.now_us += TICK_US
            self.device.tick()
            self.model.event("judge", self.device.now_us)
            assert self.device.closed == self.model.closed
        self.device.now_us += late_us

    @rule(before_us=st.integers(-2, 2))
    def wait_for_the_edge(self, before_us: int) -> None:
        """Heartbeats and judgements on both sides of the timeout."""
        if self.model.alive is not None:
            edge_us = self.model.alive + self.model.timeout_us - before_us
            self.device.now_us = max(self.device.now_us, edge_us)
            self.device.tick()
            self.model.event("judge", self.device.now_us)

    @rule()
    def main_loop(self) -> None:
        self.device.answers()

    @invariant()
    def agrees(self) -> None:
        if hasattr(self, "device"):
            assert self.device.closed == self.model.closed
            lost = self.device.bridge.line.state == self.device.lib.LINE_LOST
            assert lost == self.model.lost


SETTINGS = settings(
    max_examples=examples(60), stateful_step_count=40, suppress_health_check=list(HealthCheck)
)


def test_the_board_over_a_serial_link(library: Library) -> None:
    machine = type("SerialLine", (Line,), {"library": library})
    machine.TestCase.settings = SETTINGS
    machine.TestCase().runTest()


def test_the_board_over_can(library: Library) -> None:
    machine = type("CanLine", (Line,), {"library": library, "link": 1})
    machine.TestCase.settings = SETTINGS
    machine.TestCase().runTest()
