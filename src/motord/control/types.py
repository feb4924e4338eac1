"""The records that pass through the control kernel, one element arrays of these dtypes.

`Feedback` comes from the HAL, `Setpoint` from the supervisor, `Command` goes to the HAL, `Memory`
is what the kernel remembers from tick to tick, `Parameters` those of bench and motor.
All numbers that a recording must hold to replay a run are single precision, as in the tick.
"""

import math

from motord.config.timing import DELAY_MAX_S, RATE_MAX_HZ, SETTLING_LAGS, SILENCE_MAX_S
from motord.learned import MAX_NODES, MAX_ORDERS
from motord.schema import record_dtype

FEEDBACK = record_dtype(
    [
        ("now_ns", "i8"),  # when the tick began (Unix ns)
        ("t_ns", "i8"),  # when encoder and torque were sampled (Unix ns)
        ("t_inverter_ns", "i8"),  # when currents and voltages were sampled (Unix ns)
        ("t_status_ns", "i8"),  # when the drive stated its status (Unix ns); 0: with the currents
        ("encoder_gray", "u4"),
        ("bridge_status", "u4"),  # schema.BridgeStatus
        ("inverter_status", "u4"),  # schema.InverterStatus
        ("link_errors", "u4"),  # frames lost or corrupt since start, both links
        ("torque_Nm", "f4"),
        ("i_A", "f4", (3,)),
        ("u_V", "f4", (3,)),
        ("u_bus_V", "f4"),
        ("temperature_C", "f4"),
    ]
)

SETPOINT = record_dtype(
    [
        ("heartbeat_ns", "i8"),  # Unix ns when the supervisor last wrote
        ("seq", "u4"),
        ("request", "u4"),  # schema.Request
        ("request_seq", "u4"),  # a request is carried out once, when this changes
        ("torque_Nm", "f4"),
        ("speed_rad_s", "f4"),  # for the record only
        ("brake", "f4"),  # excitation 0 to 1: carried to simulated brakes, recorded
        ("brake_temperature_C", "f4"),
        ("drive_rad_s", "f4"),  # external drive: carried to simulated drives, recorded
        ("plan_point", "i4"),
        ("compensate", "u4"),  # schema.Compensate
        ("channels_beyond", "u4"),  # slow channels beyond a trip limit, or broken with one
        ("i2t_derating", "f4"),  # part of i2t_time_s that a warm winding takes away, 0 to 1
        # errors to induce on purpose, zero for none (Poels 2008, ch. 4: sensitivity)
        ("induced_gain", "f4", (3,)),  # currents times 1 + this
        ("induced_offset_A", "f4", (3,)),  # added to the currents
        ("induced_cogging", "f4"),  # compensated cogging torque times 1 + this
    ]
)

COMMAND = record_dtype(
    [
        ("i_A", "f4", (3,)),
        ("enable", "u4"),  # power stage and enable line wanted on
        ("brake", "f4"),
        ("drive_rad_s", "f4"),
        # where the rotor will be when the currents flow, for drives that turn with it
        ("angle_rad", "f8"),
        ("speed_rad_s", "f8"),
        ("angle_ns", "i8"),  # when (Unix ns)
    ]
)

COMMANDS_MAX = math.ceil((SILENCE_MAX_S + (1 + SETTLING_LAGS) * DELAY_MAX_S) * RATE_MAX_HZ) + 2
"""Commands remembered at most; of a bench `PARAMETERS.commands`, enough for its oldest feedback."""

PARAMETERS = record_dtype(
    [
        ("period_s", "f8"),
        ("counts", "i8"),
        ("pole_pairs", "i8"),
        ("star", "i8"),
        ("encoder_direction", "i8"),
        ("observer_bandwidth_rad_s", "f8"),
        ("actuation_delay_s", "f8"),  # from the start of a tick until its current flows, the mean
        ("alpha", "f8", (3,)),  # current gain of each phase, product 1
        ("beta_A", "f8", (3,)),  # current offset of each phase
        ("delta_epsilon", "f8"),  # common gain
        # mesh of the learned torque; learned_orders is 0 where nothing was learned
        ("learned_torques", "i8"),
        ("learned_speeds", "i8"),
        ("learned_orders", "i8"),
        ("learned_order", "i8", (MAX_ORDERS,)),
        ("learned_torque_Nm", "f8", (MAX_NODES,)),
        ("learned_speed_rad_s", "f8", (MAX_NODES,)),
        ("torque_limit_Nm", "f8"),
        ("torque_rate_Nm_per_s", "f8"),
        ("ramp_down_Nm_per_s", "f8"),  # to zero, on disable and without a supervisor
        ("current_limit_A", "f8"),
        ("trip_current_A", "f8"),
        ("i2t_current_A", "f8"),
        ("i2t_time_s", "f8"),
        ("trip_speed_rad_s", "f8"),
        ("trip_torque_Nm", "f8"),
        ("trip_temperature_C", "f8"),
        ("bus_V_min", "f8"),
        ("bus_V_max", "f8"),
        ("encoder_jump_rad", "f8"),
        ("link_errors_per_s", "f8"),
        ("current_error_A", "f8"),
        ("torque_error_Nm", "f8"),
        ("torque_per_A", "f8"),  # Nm/A, the most that a phase makes of its current
        ("settling_ns", "i8"),  # from the start of a tick until its current has settled
        ("commands", "i8"),  # how many are remembered
        ("lasts_ns", "i8", (32,)),  # for how long each trip's condition may hold
        ("torque_decay", "f8"),  # of the torque sensor's high-pass over a period
        ("brake_trip_C", "f8"),
        ("tracks", "i8"),  # of the encoder, watched for being stuck
        ("sample_gap_ns", "i8"),  # from one of its samples to the next if some are missing
        ("bridge_stale_s", "f8"),
        ("inverter_stale_s", "f8"),
        ("supervisor_timeout_s", "f8"),
        ("enable_timeout_s", "f8"),
        ("overrun_ticks", "i8"),
        ("simulated", "i8"),
        # a drive that takes d and q (`control.park`)
        ("turning", "i8"),  # it turns its set-point with the rotor between commands
        ("q_only", "i8"),  # it makes current along its q axis alone
        ("axes_rad", "f8"),  # electrical angle of its d axis at angle 0
        ("axes_sequence", "f8"),  # -1: the phases follow each other backwards
        ("axes_age_s", "f8"),  # of its angle when its current flows
    ]
)

MEMORY = record_dtype(
    [
        ("now_ns", "i8"),  # when the tick before began
        ("t_ns", "i8"),  # time of the newest encoder sample used
        ("t_bridge_ns", "i8"),  # times of the newest samples seen, used or not
        ("t_inverter_ns", "i8"),
        ("angle_rad", "f8"),  # at t_ns, 0 to 2 pi
        ("speed_rad_s", "f8"),
        # acquisition: the newest implausible sample, and by how much the rotor turned since when
        ("seen_ns", "i8"),
        ("seen_rad", "f8"),
        ("swept_rad", "f8"),
        ("swept_from_ns", "i8"),
        ("torque_set_Nm", "f8"),  # after ramp and limits
        ("heat_s", "f8", (3,)),  # I2t accumulator of each phase
        ("recent_link_errors", "f8"),  # link errors of about the last second
        ("link_errors", "i8"),
        ("missed", "i8"),
        ("arming_s", "f8"),  # time since enabling began
        ("off_by_ns", "i8"),  # when a drive that was commanded to be off surely was
        ("fast_until_ns", "i8"),  # so long a speed above its limit bars enabling and reset
        ("torque_expected_Nm", "f8"),  # set-point as the torque sensor should show it
        ("torque_asked_Nm", "f8"),  # set-point with the gain that is induced
        ("torque_before_Nm", "f8"),  # the same a tick before
        ("torque_cut_Nm", "f8"),  # the most torque that limited currents lacked lately
        ("deviation_Nm", "f8"),  # that, and the most torque that induced offsets make
        ("deviation_mean_Nm", "f8"),  # what the torque sensor's high-pass takes for its mean
        # encoder tracks: time and count of the newest code, by how much it differed from the one
        # before, the newest sound count over all turns, and when and where each track changed
        ("tracks_ns", "i8"),
        ("track_counts_per_s", "f8"),
        ("turned_counts", "i8"),
        ("track_patterns", "i8", (32,)),
        ("track_ns", "i8", (32,)),
        ("gray", "u4"),
        ("track_samples", "u4"),
        ("track_count", "i4"),
        ("state", "u4"),
        ("trip_bits", "u4"),
        ("first_trip", "u4"),
        ("request_seq", "u4"),
        ("since_ns", "i8", (32,)),  # when each trip's condition began to hold, or its count
        ("evidence_ns", "i8", (32,)),  # of conditions that are counted: when the newest came
        ("conditions_held", "u4"),  # conditions that hold by the newest evidence of each
        ("causes", "u4"),  # those that have held for longer than they may
        ("implausible", "u4"),  # encoder samples that the speed cannot explain, since two it could
        ("encoder_count", "i4"),
        ("started", "u1"),  # the first tick is over
        ("sound", "u1"),  # the speed explains the newest encoder sample
        ("tracking", "u1"),  # the observer has an angle
        ("acquiring", "u1"),  # it looks for the speed at which to start afresh
        ("arming", "u1"),  # READY, on the way to ENABLED
        ("stopping", "u1"),  # ENABLED, ramping to READY
        ("not_compared", "u4"),  # conditions that this tick's feedback says nothing of
        ("in_doubt", "u4"),  # those that it may show or not
        ("counting", "u4"),  # those whose time is counted that have a count, or just began to
        # the last commands, a ring (`control.plausible`)
        ("commands", "i8"),  # how many are in it
        ("newest", "i8"),  # where
        ("command_ns", "i8", (COMMANDS_MAX,)),  # when the tick of each began
        ("command_A", "f4", (COMMANDS_MAX, 3)),
    ]
)
