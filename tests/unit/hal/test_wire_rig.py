import numpy as np
import pytest

from motord.hal.base import DeviceError
from motord.hal.wire_rig import WireRig
from tests.contract.benches import new_command, new_feedback


class Recorder:
    """A driver of either kind that notes what it is asked."""

    def __init__(self, name: str, log: list[str], failing: str = "") -> None:
        self._name, self._log, self._failing = name, log, failing

    def _note(self, what: str) -> None:
        self._log.append(f"{self._name}.{what}")
        if self._failing == what:
            raise DeviceError(f"{self._name} fails to {what}")

    def open(self) -> None:
        self._note("open")

    def read(self, now_ns: int, feedback: np.ndarray) -> None:
        self._note("read")
        feedback["link_errors"] += 7

    def write(self, command: np.ndarray) -> None:
        self._note("write")

    def safe_stop(self) -> None:
        self._note("safe_stop")

    def close(self) -> None:
        self._note("close")


def rig_of(log: list[str], inverter: str = "", bridge: str = "") -> WireRig:
    return WireRig(Recorder("inverter", log, inverter), Recorder("bridge", log, bridge))


def test_link_errors_of_both_are_added_anew_each_time() -> None:
    rig, feedback = rig_of([]), new_feedback()
    for _ in range(2):
        rig.read(123, feedback)
        assert feedback["link_errors"][0] == 14
        assert feedback["now_ns"][0] == 123


def test_currents_go_out_first() -> None:
    log: list[str] = []
    rig_of(log).write(new_command())
    assert log == ["inverter.write", "bridge.write"]


def test_neither_stays_open_if_one_cannot_be_opened() -> None:
    log: list[str] = []
    with pytest.raises(DeviceError, match="inverter fails"):
        rig_of(log, inverter="open").open()
    assert log == ["bridge.open", "inverter.open", "bridge.close"]


@pytest.mark.parametrize("what", ["safe_stop", "close"])
@pytest.mark.parametrize("victim", ["inverter", "bridge"])
def test_one_that_fails_does_not_keep_the_other_from_stopping(what: str, victim: str) -> None:
    log: list[str] = []
    rig = rig_of(log, **{victim: what})
    with pytest.raises(DeviceError):
        getattr(rig, what)()
    assert log == [f"inverter.{what}", f"bridge.{what}"]
