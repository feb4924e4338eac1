"""The drive maps of docs/drives.md on a python-can virtual bus of their own."""

from typing import Any

import numpy as np

from motord.config import CanConfig, Config
from motord.control.park import DqFrame
from motord.hal.inverter.dq_currents import DqInverter
from tests.contract.benches import new_command, new_feedback
from tests.contract.peers import CONNECT_S, bench
from tests.support.ports import free_port
from tests.unit.wire.test_drives import INVERTERS


def shipped(name: str, canopen: dict[str, Any] | None = None, **signals: Any) -> Config:
    """Return a bench with the map of a drive, on a bus of its own.

    `canopen` is instead of the table of that name, `signals` changes the map.
    """
    inverter = INVERTERS[name]
    assert inverter.can is not None
    can = inverter.can.model_dump()
    can |= {
        "interface": "virtual",
        "channel": f"{name}-{free_port()}",
        "connect_timeout_s": CONNECT_S,
    }
    can["signals"] |= signals
    if canopen is not None:
        can["canopen"] = canopen
    config = bench(CanConfig.model_validate(can))
    section = {**inverter.model_dump(), "can": config.inverter.can}
    return Config.model_validate({**config.model_dump(), "inverter": section})


def command_along(config: Config, i_d_A: float, i_q_A: float, angle_rad: float = 0.7) -> np.ndarray:
    """Return the command of phase currents that is d and q along the drive's axes, enabled."""
    frame = DqFrame.of(config)
    scale = config.inverter.dq.scale
    command = new_command(frame.from_drive(angle_rad, 0.0, scale * i_d_A, scale * i_q_A), 1)
    command["angle_rad"] = angle_rad
    return command


def feedback_of(driver: DqInverter, now_ns: int) -> np.ndarray:
    """Return what the driver has read."""
    feedback = new_feedback()
    driver.read(now_ns, feedback)
    return feedback
