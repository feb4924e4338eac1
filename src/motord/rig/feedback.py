"""Between the records of the rig and those of the control kernel, compiled."""

import numpy as np

from motord.jit import constants, jit
from motord.schema import BridgeStatus, InverterStatus

_BRIDGE, _INVERTER = constants(BridgeStatus), constants(InverterStatus)


@jit
def fill_feedback(
    rig_output: np.ndarray, t_ns: int, torque_Nm_per_count: float, feedback: np.ndarray
) -> None:
    """Fill a FEEDBACK, shape (1,), with sensor readings that were all taken at `t_ns`.

    `torque_Nm_per_count` is as configured for torque sensor and converter.
    """
    o, f = rig_output[0], feedback[0]
    f.now_ns = f.t_ns = f.t_inverter_ns = t_ns
    f.encoder_gray = o.encoder_gray
    f.torque_Nm = o.torque_counts * torque_Nm_per_count
    for phase in range(3):
        f.i_A[phase] = o.i_sensed_A[phase]
        f.u_V[phase] = o.u_V[phase]
    f.u_bus_V = o.u_bus_V
    f.temperature_C = o.temperature_C
    f.link_errors = 0
    status = _INVERTER.READY if o.inverter_on else 0
    status |= _INVERTER.FAULT if o.fault else 0
    f.inverter_status = status | (_INVERTER.ENABLE_LINE if o.enable_line else 0)
    status = _BRIDGE.ENABLE_LINE if o.enable_line else 0
    f.bridge_status = status | (_BRIDGE.TORQUE_INVALID if o.torque_clipped else 0)


@jit
def apply_command(command: np.ndarray, rig_input: np.ndarray) -> None:
    """Put a COMMAND into a RIG_INPUT, both shape (1,); the enable line follows the command."""
    c, i = command[0], rig_input[0]
    for phase in range(3):
        i.i_command_A[phase] = c.i_A[phase]
    i.enable_command = c.enable
    i.enable_line = c.enable
    i.brake = c.brake
    i.drive_rad_s = c.drive_rad_s
