"""The records of the simulated rig, one element arrays of these dtypes.

`RIG_PARAMETERS` and `RIG_STATE` come from `rig.build`; `RIG_INPUT` is what the world does to the
rig, all zero if it is left alone; `RIG_OUTPUT` is what its sensors say. SI units; [3] is phases a,
b, c.
"""

from motord.config.timing import RATE_MAX_HZ
from motord.rig.faults import FAULT_STATE, INJECTED
from motord.rig.truth import MAX_DEPARTURES, MAX_ORDERS
from motord.rig.truth.inverter import DEAD_TIME_MAX_S
from motord.rig.truth.swing import MAX_SPRINGS
from motord.schema import record_dtype

QUEUE_LENGTH = round(DEAD_TIME_MAX_S * RATE_MAX_HZ) + 2
"""Current commands that can be under way at once during the dead time."""

HARMONICS = record_dtype(
    [
        ("terms", "i8"),
        ("orders", "f8", (MAX_DEPARTURES,)),
        ("amplitude", "f8", (MAX_DEPARTURES,)),
        ("phase_rad", "f8", (MAX_DEPARTURES,)),
    ]
)
"""A sum of amplitude sin(order theta + phase), the first `terms` of them in use."""

RIG_INPUT = record_dtype(
    [
        # newest command that the inverter has, of phases, or (d, q, -); not finite counts as 0
        ("i_command_A", "f8", (3,)),
        ("brake", "f8"),  # excitation asked for, 0 to 1
        ("drive_rad_s", "f8"),  # speed asked of the external drive; not 0 puts the belt on
        ("injected", INJECTED),
        ("enable_command", "u4"),  # the inverter is commanded on
        ("enable_line", "u4"),  # the hardware enable line is closed
        ("fault", "u4"),  # not 0: the inverter has a fault and stays off
    ]
)

RIG_OUTPUT = record_dtype(
    [
        ("i_sensed_A", "f8", (3,)),  # sensed currents i*
        ("u_V", "f8", (3,)),  # voltage across each winding
        ("i_d_A", "f8"),  # the same along the drive's axes, if it turns with the rotor
        ("i_q_A", "f8"),
        ("u_d_V", "f8"),
        ("u_q_V", "f8"),
        ("u_bus_V", "f8"),
        ("temperature_C", "f8"),  # inverter
        ("brake_temperature_C", "f8"),
        ("brake", "f8"),  # excitation that the brake has
        ("drive_rad_s", "f8"),  # speed that the external drive has
        ("torque_Nm", "f8"),  # torque_counts through the sensor's nominal gain
        ("torque_counts", "i4"),  # signed output of the converter
        ("torque_clipped", "u4"),  # the converter is at the end of its range
        ("encoder_count", "i4"),
        ("encoder_gray", "u4"),
        ("inverter_on", "u4"),  # power stage on and following the commands
        ("enable_line", "u4"),
        ("fault", "u4"),
    ]
)

RIG_PARAMETERS = record_dtype(
    [
        # integration
        ("substep_s", "f8"),
        ("slow_every", "i8"),  # substeps between updates of temperatures and drifts
        # back-EMF (rows of phases a, b, c) and cogging: sum of c cos(m x) + s sin(m x)
        ("base_order", "i8"),  # x = base_order theta
        ("order_count", "i8"),
        ("order", "i8", (MAX_ORDERS,)),  # m, rising
        ("wave_cos", "f8", (4 * MAX_ORDERS,)),  # [4 row + 0, 1, 2: phase; 3: cogging]
        ("wave_sin", "f8", (4 * MAX_ORDERS,)),
        # departures from the controller's model (`rig.departures`)
        ("loaded", "i8"),  # back-EMF or cogging change with current or temperature
        ("back_emf_drop_per_A", "f8"),
        ("back_emf_per_K", "f8"),
        ("cogging_rise_per_A", "f8"),
        ("sensor_departs", "i8"),  # it is loaded with more than the stator's torque
        ("friction_ripple", HARMONICS),
        ("torque_crosstalk", HARMONICS),
        ("encoder_error", HARMONICS),
        ("current_crosstalk", "i8"),
        ("current_mixed", "f8", (9,)),  # sensed from i*, row by row
        ("current_unmixed", "f8", (9,)),  # its inverse
        # windings and inverter
        ("star", "i8"),
        ("resistance_ohm", "f8"),  # at the temperature of the room
        ("resistance_per_K", "f8"),
        ("winding_J_per_K", "f8"),  # of a phase; the next two are of a phase, too
        ("winding_housing_W_per_K", "f8"),
        ("winding_magnet_W_per_K", "f8"),
        ("magnet_J_per_K", "f8"),
        ("magnet_housing_W_per_K", "f8"),
        ("housing_J_per_K", "f8"),
        ("housing_ambient_W_per_K", "f8"),
        ("inductance_H", "f8"),
        ("bus_V", "f8"),
        ("dead_steps", "f8"),  # dead time in substeps
        ("loop_rate_per_s", "f8"),  # 1 / time constant of the current loops
        ("loop_decay", "f8"),  # part of a current error that remains after a substep
        ("current_max_A", "f8"),
        ("ready_steps", "i8"),
        ("gain", "f8", (3,)),  # alpha epsilon at the reference temperature
        ("beta_A", "f8", (3,)),
        # axes of a drive that turns with the rotor (`rig.park`)
        ("axes", "i8"),  # PHASES, TURNING or LATCHED: what the commands are
        ("axes_pole_pairs", "f8"),
        ("axes_sign", "f8"),  # -1: the drive's positive direction is the rig's negative one
        ("axes_order", "f8"),  # -1: its phases b and c are those that follow forwards
        ("axes_rad", "f8"),
        ("axes_age_s", "f8"),
        ("axes_scale", "f8"),
        # nonlinearity of the current sensors: amplitude sin(wave i* + phase)
        ("nonlinear", "i8"),
        ("nonlinearity_A", "f8", (3,)),
        ("nonlinearity_rad_per_A", "f8"),
        ("nonlinearity_phase_rad", "f8", (3,)),
        ("nonlinearity_per_A", "f8", (3,)),
        ("nonlinearity_per_A2", "f8", (3,)),
        ("gain_drift_per_K", "f8", (3,)),
        ("gain_drift_max", "f8"),
        ("reference_C", "f8"),
        ("ambient_C", "f8"),
        ("inverter_K_per_W", "f8"),
        ("inverter_decay", "f8"),  # of its temperature, over slow_every substeps
        ("current_noise_A", "f8"),
        ("voltage_noise_V", "f8"),
        ("inverter_fixed_W", "f8"),  # losses of the inverter (`rig.energy`)
        ("inverter_loss_V", "f8"),
        ("inverter_loss_ohm", "f8"),
        # mechanics
        ("inertia_kg_m2", "f8"),
        ("viscous_Nm_s_per_rad", "f8"),
        ("coulomb_Nm", "f8"),
        ("static_Nm", "f8"),
        # brake
        ("brake_torque_max_Nm", "f8"),
        ("brake_critical_rad_s", "f8"),
        ("brake_critical_per_K", "f8"),
        ("brake_excitation_decay", "f8"),  # over a substep
        ("brake_K_per_W", "f8"),
        ("brake_decay", "f8"),  # of its temperature, over slow_every substeps
        # drive and belt
        ("drive_max_rad_s", "f8"),
        ("drive_change_rad_s", "f8"),  # largest change of speed in a substep
        ("belt_Nm_per_rad", "f8"),
        ("belt_Nm_s_per_rad", "f8"),
        ("belt_slip_Nm", "f8"),
        ("belt_lift_rad_s", "f8"),
        ("belt_creep_per_Nm", "f8"),
        # torque sensor: mount x' = A x + B0 u0 + B1 u1 over a substep, input straight between
        ("mount_a", "f8", (4,)),
        ("mount_b", "f8", (4,)),
        ("mount_rigid", "i8"),
        ("highpass", "i8"),
        ("highpass_decay", "f8"),
        ("highpass_gain", "f8"),  # answer to a straight input of unit rise over a substep
        ("drift_gain_s", "f8"),  # answer to a drift of 1 Nm/s over a substep
        ("drift_decay", "f8"),  # of the drift rate, over slow_every substeps
        ("drift_kick_Nm_per_s", "f8"),
        ("torque_counts_per_Nm", "f8"),  # true: with delta
        ("torque_Nm_per_count", "f8"),  # nominal
        ("torque_noise_counts", "f8"),
        ("sensor_has_friction", "i8"),  # it is loaded with the friction, too
        ("torque_count_max", "i8"),
        # encoder
        ("counts", "i8"),
        ("encoder_offset_rad", "f8"),
        ("encoder_direction", "i8"),
        # bar and springs, and the hand that deflects the bar
        ("swing", "i8"),  # there is a bar; else the rest means nothing
        ("spring_count", "i8"),
        ("spring_N_per_m", "f8", (MAX_SPRINGS,)),
        ("spring_lever_m", "f8", (MAX_SPRINGS,)),
        ("spring_side", "f8", (MAX_SPRINGS,)),
        ("spring_length_m", "f8"),
        ("spring_stretch_m", "f8"),
        ("rest_angle_rad", "f8"),
        ("deflection_rad", "f8"),
        ("deflection_spread", "f8"),
        ("pull_s", "f8"),
        ("hold_s", "f8"),
        ("swing_s", "f8"),
    ]
)

RIG_STATE = record_dtype(
    [
        ("step", "i8"),  # substeps since the start
        ("remainder_s", "f8"),  # time asked for and not yet stepped through
        ("random", "u8"),
        # commands on their way: ring of times (in substeps) and currents
        ("queue_head", "i8"),
        ("queue_size", "i8"),
        ("queue_step", "f8", (QUEUE_LENGTH,)),
        ("queue_A", "f8", (3 * QUEUE_LENGTH,)),
        ("i_newest_A", "f8", (3,)),  # newest command taken in
        ("i_command_A", "f8", (3,)),  # command in force
        # inverter and windings
        ("inverter_on", "i8"),
        ("enable_line", "i8"),
        ("fault", "i8"),
        ("wanted", "i8"),  # commanded on, line closed, no fault
        ("on_steps", "i8"),  # substeps since then
        ("i_loop_A", "f8", (3,)),  # what the loops control: i*, in a star less its mean
        ("i_slope_A_per_s", "f8", (3,)),  # its rate when last looked at
        ("i_sensed_A", "f8", (3,)),
        ("i_A", "f8", (3,)),  # what flows
        ("gain", "f8", (3,)),  # alpha epsilon, with drift
        ("gain_now", "f8", (3,)),  # of small changes of the current, when last looked at
        ("k_V_s_per_rad", "f8", (3,)),
        ("temperature_C", "f8"),
        ("resistance_ohm", "f8", (3,)),
        ("winding_C", "f8", (3,)),  # of each phase
        ("magnet_C", "f8"),
        ("housing_C", "f8"),
        # mechanics
        ("angle_rad", "f8"),
        ("speed_rad_s", "f8"),
        ("acceleration_rad_s2", "f8"),  # mean over the last substep
        ("torque_em_Nm", "f8"),
        ("torque_cog_Nm", "f8"),
        *((name, "f8") for name in ("energy_dc_J", "energy_shaft_J")),  # since the start
        # brake
        ("brake_set", "f8"),
        ("excitation", "f8"),
        ("brake_coefficient_Nm_s_per_rad", "f8"),
        ("brake_temperature_C", "f8"),
        # drive and belt
        ("drive_set_rad_s", "f8"),
        ("engaged", "i8"),  # belt on
        ("drive_rad_s", "f8"),
        ("belt_twist_rad", "f8"),
        ("belt_Nm", "f8"),  # of its spring
        ("belt_before_Nm", "f8"),  # a substep ago
        ("belt_Nm_s_per_rad", "f8"),  # its damping; none while it slips
        # torque sensor
        ("load_Nm", "f8"),  # on its mount, where it departs from the stator's torque
        ("mount_Nm", "f8"),
        ("mount_rate_Nm", "f8"),  # rate of mount_Nm over its natural frequency
        ("sensor_Nm", "f8"),
        ("sensor_rate_Nm_per_s", "f8"),
        ("drift_Nm_per_s", "f8"),
        # the hand at the bar
        ("hand", "i8"),  # 0 off the bar, 1 pulling, 2 holding
        ("hand_s", "f8"),  # until it does something else
        ("hand_target_rad", "f8"),
        ("injected", INJECTED),
        *FAULT_STATE,
    ]
)
