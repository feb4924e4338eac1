"""The driver of a drive that takes d and q: angles, and what a drive does not say."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from motord.config import Config
from motord.control.park import DqFrame
from motord.hal.inverter.dq_currents import DqInverter
from motord.hal.registry import make_rig
from motord.hal.wire_rig import WireRig
from motord.schema import InverterStatus
from tests.contract.benches import dq_config, new_command, new_feedback
from tests.contract.peers import Drive, bench, until

AGE_S = 2e-4
SPEED_RAD_S = 30.0
POLE_PAIRS = 8


@pytest.fixture
def drive() -> Iterator[Drive]:
    peer = Drive(dq_config())
    yield peer
    peer.close()


def opened(drive: Drive, **inverter: Any) -> tuple[DqInverter, Config]:
    """Return the driver of `drive`, opened, and its bench."""
    content = bench(drive._config).model_dump()
    content["inverter"] |= inverter
    content["inverter"]["can"]["signals"] = drive._config.signals.model_dump()
    config = Config.model_validate(content)
    driver = DqInverter(config)
    driver.open()
    return driver, config


def command_at(angle_rad: float, i_A: tuple[float, ...], angle_ns: int = 0) -> np.ndarray:
    command = new_command(i_A, 1)
    command["angle_rad"], command["speed_rad_s"] = angle_rad, SPEED_RAD_S
    command["angle_ns"] = angle_ns
    return command


def test_the_registry_knows_it() -> None:
    rig = make_rig(bench(dq_config()))
    assert isinstance(rig, WireRig)
    assert isinstance(rig._inverter, DqInverter)


@pytest.mark.parametrize("angle_rad", [0.0, 0.3, 5.1])
def test_the_same_along_the_axes_at_every_angle(drive: Drive, angle_rad: float) -> None:
    """Currents that turn with the rotor are the same d and q wherever it is."""
    driver, config = opened(drive, dq={"angle_age_s": AGE_S})
    axes = DqFrame.of(config)
    seen_rad = angle_rad - SPEED_RAD_S * AGE_S
    i_A = axes.from_drive(seen_rad, 0.0, 1.0, 5.0)

    def has_command() -> bool:
        driver.write(command_at(angle_rad, i_A))
        return drive.enable and drive.i_A[:2] == pytest.approx((1.0, 5.0), abs=2e-3)

    drive.enable = False
    until(has_command)
    driver.close()


def test_phase_currents_of_when_they_were_sensed(drive: Drive) -> None:
    """What is read between commands has turned by the speed times the time since."""
    drive.values |= {"i_d_A": 1.0, "i_q_A": 5.0, "u_d_V": 0.5, "u_q_V": -2.0}
    driver, config = opened(drive)
    axes = DqFrame.of(config)
    feedback = new_feedback()
    until(lambda: _read(driver, feedback)["i_A"].any())
    at_ns = int(feedback["t_inverter_ns"][0])
    drive.silent = True
    until(lambda: int(_read(driver, feedback)["t_inverter_ns"]) == at_ns or _forget(feedback))
    at_ns = _settled(driver, feedback)
    driver.write(command_at(1.0, (0.0, 0.0, 0.0), at_ns + 3_000_000))
    angle_rad = 1.0 - SPEED_RAD_S * 3e-3
    row = _read(driver, feedback)
    assert row["i_A"] == pytest.approx(axes.from_drive(angle_rad, 0.0, 1.0, 5.0), abs=6e-3)
    assert row["u_V"] == pytest.approx(axes.from_drive(angle_rad, 0.0, 0.5, -2.0), abs=3e-2)
    driver.close()


def _read(driver: DqInverter, feedback: np.ndarray) -> np.record:
    feedback["link_errors"] = 0
    driver.read(1_800_000_000_000_000_000, feedback)
    return feedback[0]


def _forget(feedback: np.ndarray) -> bool:
    feedback["t_inverter_ns"] = 0
    return True


def _settled(driver: DqInverter, feedback: np.ndarray) -> int:
    """Return when the currents were sensed, once nothing new comes any more."""

    def still() -> int:
        before = [int(_read(driver, feedback)["t_inverter_ns"]) for _ in range(200)]
        return before[0] if len(set(before)) == 1 else 0

    return int(until(still))


def test_a_drive_that_says_q_alone_has_no_d_and_no_voltages() -> None:
    names = ("command_i_d_A", "feedback_i_d_A", "feedback_u_d_V", "feedback_u_q_V")
    signals = dict.fromkeys((*names, "command_counter", "feedback_counter"), "")
    drive = Drive(dq_config(**signals))
    drive.values["i_q_A"] = 4.0
    driver, config = opened(drive)
    feedback = new_feedback()
    i_A = pytest.approx(DqFrame.of(config).from_drive(0.0, 0.0, 0.0, 4.0), abs=6e-3)
    until(lambda: _read(driver, feedback)["i_A"] == i_A)
    assert np.isnan(feedback["u_V"]).all()
    driver.close()
    drive.close()


def test_a_drive_that_says_nothing_of_its_state_is_ready() -> None:
    """And one without an enable signal is switched off by the enable line, and by zero current."""
    drive = Drive(dq_config(command_enable_value=1, command_constants={}).model_copy(deep=True))
    drive.close()
    signals = dq_config().signals.model_dump() | {
        "command_enable": "",
        "command_constants": {},
        "feedback_status": "",
        "feedback_counter": (),
        "feedback_crc": (),
    }
    config = dq_config().model_dump() | {"signals": signals}
    drive = Drive(type(dq_config()).model_validate(config))
    driver, _ = opened(drive)
    feedback = new_feedback()
    assert _read(driver, feedback)["inverter_status"] == InverterStatus.READY
    until(lambda: driver.write(command_at(0.0, (1.0, 0.0, -1.0))) or drive.i_A[1] != 9.0)
    driver.safe_stop()
    until(lambda: drive.i_A == (0.0, 0.0, 0.0))
    assert drive.enable  # nothing says otherwise
    driver.close()
    drive.close()


@pytest.mark.parametrize("wild", [math.nan, math.inf])
def test_an_angle_that_is_no_number_is_no_current(drive: Drive, wild: float) -> None:
    driver, _ = opened(drive)
    until(lambda: driver.write(command_at(wild, (1.0, 0.0, -1.0))) or drive.i_A == (0.0, 0.0, 0.0))
    driver.close()
