# %% [markdown]
# # A session in a notebook
#
# From connecting to a running bench to a measured cogging torque, with the Python client
# ([api.md](api.md#from-python)). This page is made from [notebook.py](notebook.py), which runs as
# it is against `motord run`, in a terminal or cell by cell in an editor that knows `# %%`.
#
# ## Connect
#
# `connect()` takes the only bench behind the endpoint in `MOTORD_CONNECT`, or on this machine.

# %%
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from motord.client import connect

client = connect()
state = client.state()
print(f"{state.bench}: {state.motor}, {state.state}, loop at {state.loop.rate_Hz:g} Hz")

# %% [markdown]
# Everybody may look. To command takes the lease, which one client holds at a time; it is renewed
# in the background, and given back at the end of the block. The bench then ramps down and is
# disabled.
#
# ## Step the torque
#
# Every tick of the loop comes in blocks, structured numpy arrays. The brake holds the rotor at
# one turn a second while the torque goes from 1 Nm to 3 Nm.

# %%
TURNS = 4  # at each torque
SPEED_Hz = 1.0


def collect(ticks, turns):
    """Return so many turns of ticks from now on."""
    blocks = [ticks.get()]
    while (blocks[-1]["t_ns"][-1] - blocks[0]["t_ns"][0]) * 1e-9 < turns / SPEED_Hz:
        blocks.append(ticks.get())
    return np.concatenate(blocks)


with client.lease("notebook") as lease:
    reply = lease.set(enable=True, torque_Nm=1.0, speed_Hz=SPEED_Hz)
    time.sleep(reply.reached_in_s + 1.0)
    with client.subscribe_ticks() as ticks:
        low = collect(ticks, TURNS)
        lease.set(torque_Nm=3.0)
        high = collect(ticks, TURNS + 2)
    print(ticks.losses)

# %% [markdown]
# `losses` has ticks that were lost on the way (none here), and periods that the loop itself
# missed.

# %%
both = np.concatenate([low, high])
t_s = (both["t_ns"] - high["t_ns"][0]) * 1e-9

figure, (above, below) = plt.subplots(2, 1, figsize=(9, 4.6), sharex=True, layout="constrained")
above.plot(t_s, both["torque_Nm"], color="#c2502f", linewidth=0.5, label="measured")
above.plot(t_s, both["torque_set_Nm"], color="#20242b", label="set")
above.set(ylabel="torque (Nm)", title="A step of torque: the sensor does not pass the mean")
above.legend(loc="upper left", ncols=2)
below.plot(t_s, both["speed_rad_s"] / (2 * np.pi), color="#1670a8")
below.set(xlabel="time (s)", ylabel="speed (Hz)", xlim=(t_s[0], t_s[-1]))

# %% [markdown]
# The brake rises first, which slows the rotor, and the torque follows. The sensor of this bench
# is piezoelectric (`torque_sensor` in the state): it shows a step for some seconds, and of a
# steady torque the ripple.
#
# ## Torque over angle, and its orders
#
# Torque ripple belongs to angles, not to times. The last whole turns are laid over each other at
# equal angles, each without its straight line, which is left of the step. What they have in
# common is of the motor, and its Fourier transform has the amplitude at each order of a turn.

# %%
POINTS = 256  # in a turn


def by_turn(block, turns):
    """Return torque (turns, POINTS) at equal angles of the last whole turns of a block."""
    angle_rad = np.unwrap(block["angle_rad"].astype(float))
    if angle_rad[-1] < angle_rad[0]:
        angle_rad = -angle_rad
    last = np.floor(angle_rad[-1] / (2 * np.pi))
    grid = 2 * np.pi * (last - turns + np.arange(turns * POINTS) / POINTS)
    return np.interp(grid, angle_rad, block["torque_Nm"]).reshape(turns, POINTS)


turns_Nm = by_turn(high, TURNS)
x = np.arange(POINTS) - (POINTS - 1) / 2
turns_Nm -= turns_Nm.mean(axis=1, keepdims=True) + np.outer(turns_Nm @ x, x) / (x @ x)
mean_Nm = turns_Nm.mean(axis=0)
amplitude_Nm = 2 * np.abs(np.fft.rfft(mean_Nm)) / POINTS
pole_pairs = client.config().config["motor"]["pole_pairs"]

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
degrees = 360 * np.arange(POINTS) / POINTS
left.plot(degrees, turns_Nm.T, color="#c2502f", linewidth=0.5, alpha=0.6)
left.plot(degrees, mean_Nm, color="#20242b", linewidth=1.0)
left.set(xlabel="angle (degrees)", ylabel="torque (Nm)", xlim=(0, 360), xticks=range(0, 361, 60))
left.set_title(f"The last {TURNS} turns at 3 Nm, and their mean")
right.vlines(np.arange(65), 0, amplitude_Nm[:65], color="#1670a8", linewidth=2.0)
for order, cause in ((1, "current\noffsets"), (2, "current\ngains"), (6, "cogging")):
    height_Nm = amplitude_Nm[order * pole_pairs]
    right.annotate(
        cause, (order * pole_pairs, height_Nm), (0, 4), textcoords="offset points", ha="center"
    )
right.set(xlabel="order (per turn)", ylabel="amplitude (Nm)", xlim=(0, 64), xticks=range(0, 65, 8))
right.set_ylim(0, 1.25 * amplitude_Nm.max())
right.set_title("Amplitude at each order")
print(f"ripple {mean_Nm.std():.2f} Nm RMS")

# %% [markdown]
# Offsets of the current sensors make ripple once in an electrical period, which this motor has
# eight of in a turn; unequal gains make it twice; cogging comes with the slots. `motord analyse
# calibrate` separates them, and the daemon compensates them.
#
# ## Run a plan
#
# A plan runs in the daemon; the loop below ends with it. Had it been aborted or failed,
# `PlanEndedError` would say why. What it will do can be asked for without the lease, and without
# moving anything.

# %%
settings = {"speeds_Hz": [1.0], "turns": 4, "settle_s": 0.5}
print(f"{client.dry_run('cogging', settings).estimate_s:.0f} s to go")

with client.lease("notebook") as lease:
    step = ""
    for progress in lease.run_plan("cogging", settings, notes="from a notebook"):
        if progress.step != step:
            step = progress.step
            print(f"{progress.fraction:4.0%}  {step or 'at rest'}, {progress.eta_s:.0f} s left")
print(f"{progress.plan} {progress.state}: {progress.points_done} of {progress.points} points")

# %% [markdown]
# ## Load the recording, and analyse it
#
# Every tick of a bench that is powered or driven is recorded. The recorder closes the file of a
# plan a moment after its end; then it can be read whole, or analysed as `motord analyse cogging`
# does.

# %%
from motord.experiments.cogging.command import estimate
from motord.experiments.subject import Recordings
from motord.recording.reader import open_run

path = Path(progress.recording)
while not path.exists():
    time.sleep(0.1)
run = open_run(path)
print(f"{len(run.ticks(['tick']))} ticks, {len(run.operating_points())} operating point")

cogging = estimate(Recordings.open([path]))
for harmonic in cogging.harmonics:
    if harmonic.order == cogging.main_order:
        print(f"order {harmonic.order}: {harmonic.amplitude_Nm:.2f} Nm")

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained", sharey=True)
degrees = 360 * np.arange(cogging.tau_cog_Nm.size) / cogging.tau_cog_Nm.size
for axes, span in ((left, 360), (right, 45)):
    axes.plot(degrees, cogging.tau_cog_Nm, color="#1670a8", linewidth=1.0)
    axes.set(xlabel="angle (degrees)", xlim=(0, span), xticks=range(0, span + 1, span // 3))
left.set(ylabel="cogging torque (Nm)", title="Cogging torque of the driven rotor")
right.set_title("One electrical period")

client.close()
