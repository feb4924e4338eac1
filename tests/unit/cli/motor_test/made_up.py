"""A motor type, recordings and a bench for tests of `motord test`."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np

from motord.recording.writer import RunWriter
from motord.schema import TICK_DTYPE

MOTOR = "axial-flux 48/16"
SERIAL = "sim-1"
TYPE = f"""
motor = "{MOTOR}"

[[plan]]
name = "calibrate"
settings = {{time_limit_s = 30.0}}

[[plan]]
name = "verify"

[[limit]]
analysis = "calibrate"
figure = "alpha_spread"
high = 0.5
"""


def record(path, plan="calibrate", serial=SERIAL, notes="", name=MOTOR, **more):
    metadata = {
        "bench": "b", "motor": {"name": name, "serial": serial}, "notes": notes,
        "plan": {"name": plan} if isinstance(plan, str) else plan, **more,
    }  # fmt: skip
    ticks = np.zeros(3, TICK_DTYPE)
    ticks["t_ns"], ticks["tick"] = 1_700_000_000_000_000_000 + np.arange(3), np.arange(3)
    with RunWriter(Path(path), metadata) as writer:
        writer.ticks(ticks)
    return str(path)


class FakeClient:
    """A bench that records what it is asked to do."""

    bench = "b"

    def __init__(self, serial="", state="done"):
        self.motor = {"name": MOTOR, "serial": serial}
        self.ends_in, self.calls = state, []
        self.during = lambda: None

    def state(self):
        return SimpleNamespace(state="READY", lease=SimpleNamespace(holder=None))

    def abort_plan(self):
        self.calls.append("abort")
        self.ends_in = "aborted"

    def config(self):
        return SimpleNamespace(config={"motor": self.motor})

    def dry_run(self, name, settings):
        self.calls.append(f"dry run of {name} {settings}")

    def run_plan(self, name, settings, notes, serial):
        self.calls.append(f"{name} {settings} {notes}")
        path = record(f"{name}-{serial}-{len(self.calls)}.mcap", name, serial=serial, notes=notes)
        return FakeRun(self, name, path)


class FakeRun:
    """A plan that has ended when it is looked at, unless that is interrupted."""

    def __init__(self, client, name, path):
        self.client, self.name, self.path = client, name, path

    def __iter__(self):
        during, self.client.during = self.client.during, lambda: None
        during()
        yield SimpleNamespace(
            plan=self.name, state=self.client.ends_in, message="a trip", recording=self.path,
            fraction=1.0, over=True, points=1, points_done=1, targets={},
        )  # fmt: skip
