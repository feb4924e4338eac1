"""The times, rates, angles and shares within which every interlock keeps its stated time.

The fields of a bench file are bounded by them, and so are the rules between several fields
(`config.rules`).
"""

import math

RATE_MIN_HZ, RATE_MAX_HZ = 100, 20_000
"""Of the loop and of the bridge's samples."""
SILENCE_MAX_S = 1.0
"""No link and no process may be silent for longer without the torque being taken away: the rotor
would be driven by an outdated command."""
CONNECT_MAX_S = 60.0
"""A device answers within this time of the start, or is given up: a loop that waits for longer
hangs."""
ENABLE_MAX_S = 10.0
"""A drive is ready within this time of being enabled, or the bench trips."""
SLOW_FEEDBACK_MAX_S = 0.5
"""No message of the drive's feedback may stay away for longer, however seldom it is sent."""
OVERRUN_TICKS_MAX = round(SILENCE_MAX_S * RATE_MAX_HZ)
"""Missed periods that are no longer than that at the highest rate."""
LATE_MAX_S = 1
"""By which a frame of a simulated bench may be late."""
RAMP_DOWN_MAX_S = 1.0
"""From [limits] torque_Nm to zero, however gentle torque_rate_Nm_per_s is."""
DELAY_MAX_S = 0.02
"""Of the inverter: the angle where its current flows is predicted over this time. A drive that is
disabled is off within it: what it states afterwards is of the time since."""
SETTLING_LAGS = 3
"""Lags of the current loops after [inverter] actuation_delay_s, which has one of them, within which
a current settles: 1.8 % of a step are left."""
JUMP_MAX_RAD = math.pi / 2
"""No spacing of samples makes a larger jump of the encoder plausible: from half a turn on, the
direction is a guess."""
STEADY_S = 0.005
"""Time between samples over which the speed hardly changes: after a longer one more of a jump is
plausible, in proportion."""
POSITION_AGE_MAX_S = 0.03
"""Age of the newest position up to which it is extrapolated. Beyond it no torque is commanded: at
100 rad/s^2 the rotor may be 45 mrad further on, 0.36 rad electrically with 8 pole pairs."""
ACCELERATION_RAD_S2 = 100.0
"""No rotor that accelerates by so much may seem to jump, at any setting of the encoder's check."""
SPEED_RESOLUTION_MAX = 0.2
"""Of the speed limit: by no more may the speed be off that the encoder shows, by its counts and the
times of its samples. Set-points end so far below it."""
TRACK_PATTERNS = 3
"""An encoder track is stuck that has not changed while so many of its patterns have passed."""
SAMPLE_TIME_S = 100e-6
"""By so much the time of a bridge's sample may be wrong: of a heartbeat's way half is known."""
TURN_PER_SAMPLE_MAX_RAD = math.pi / 4
"""The rotor may turn so far from sample to sample at the speed limit: a speed well beyond it still
differs from a slower one in the other direction."""
INTERVALS_MIN = 2
"""Intervals that must pass before silence is a fault: one message may be lost."""
SUPERVISOR_TIMEOUT_MIN_S = 0.02
"""The supervisor's heartbeat comes every 10 ms, and one may be late."""
SUPERVISOR_ACTS_S = 0.05
"""Within this time the supervisor has acted on what the ticks or the clock show: two of its
steps, a plan's look and a tick."""
ORDER_S = 0.1
"""Longest time for which a set-point of the supervisor for a slow device is good."""
DRIVE_FALLS_S = 0.5
"""Within this time after anything of the daemon hangs, the speed of an external drive falls."""
DRIVE_REACTS_S = 0.1
"""Of it, what the drive itself may take."""
RING_MIN_S = 2.0
"""Half of the ring may hold a plan's ticks alone, until the recorder, which reports twice a second,
says that it records: two reports fit in it."""
RENEWAL_S = 0.2
"""A lease must leave at least this time for its renewal."""
FILE_MIN_S = 0.5
FILE_MIN_MB = 0.1
"""Shortest and smallest file of a recording: what there is between two reports of the recorder, at
1 kHz. Without a bound there is a file for every look at the ring, 72 000 in an hour."""
CHANNEL_RATE_MAX_HZ = 20.0
CHANNELS_MAX = 64
"""Slow channels: a process reads them all, and each reading is a line of text in a pipe."""
SLOW_SILENCE_MAX_S = 10.0
"""Within this time a channel beyond its trip limit, or silent, ends the current, and a brake or a
drive that does not answer takes the torque to zero."""
CURRENT_ERROR, TORQUE_ERROR = 0.25, 0.3
"""Of limits.current_A and torque_Nm: how far off current and torque may be where nothing is said.
"""
TORQUE_SHARE = 0.2
"""Part of the torque set-point by which the measured torque may be off, besides torque_error_Nm."""
