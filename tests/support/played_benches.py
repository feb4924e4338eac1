"""Daemons of benches as far as others see them on Zenoh: state, token; and routers between them."""

import threading
import time
from contextlib import ExitStack, contextmanager, suppress

import zenoh

from motord.api.endpoints import daemon_config, key, router_config
from motord.api.messages import (
    BenchState,
    DeviceView,
    LeaseView,
    LoopView,
    RecordingView,
    SetpointView,
)
from tests.support.patience import PATIENCE_S
from tests.support.ports import free_port


def endpoint():
    return f"tcp/127.0.0.1:{free_port()}"


def state_of(bench, **changes):
    """Return the state of a bench that is OFF, but for `changes`."""
    off = {
        "bench": bench,
        "motor": "a motor",
        "simulated": True,
        "version": "1",
        "t_ns": 1,
        "uptime_s": 1.0,
        "state": "OFF",
        "fault": "",
        "trips": [],
        "first_trip": "",
        "tick": None,
        "setpoint": SetpointView(
            torque_Nm=0.0, speed_Hz=None, brake=0.0, drive_Hz=0.0, compensate="off"
        ),
        "lease": LeaseView(holder=None, remaining_s=0.0, duration_s=2.0),
        "plan": None,
        "loop": LoopView(
            rate_Hz=1000.0, ticks=0, missed=0, lost_by_supervisor=0, wake_late_us_p50=None,
            wake_late_us_p99=None, wake_late_us_max=None, work_us_p99=None, age_s=None,
        ),
        "realtime": {},
        "recording": RecordingView(recording=False, path=""),
        "calibration": None,
        "brake": DeviceView(health="none"),
        "drive": DeviceView(health="none"),
        "processes": {},
        "telemetry_dropped": 0,
    }  # fmt: skip
    return BenchState(**{**off, **changes})


class PlayedBench:
    """A router as a daemon opens it. token: a liveliness token; answers: it answers for `state`."""

    def __init__(self, bench, *, token=True, answers=True, content=None):
        self.bench, self.listen = bench, endpoint()
        self.content = state_of(bench).to_json() if content is None else content
        self.session = zenoh.open(daemon_config(bench, [self.listen], 100_000))
        self.publisher = self.session.declare_publisher(key(bench, "state"))
        self._declared = []
        if answers:
            self._declared.append(
                self.session.declare_queryable(key(bench, "state"), self._answer, complete=True)
            )
        else:  # it takes the query and is stuck
            self.stuck = []
            self._declared.append(
                self.session.declare_queryable(
                    key(bench, "state"), self.stuck.append, complete=True
                )
            )
        if token:
            self._declared.append(self.session.liveliness().declare_token(key(bench, "alive")))

    def _answer(self, query):
        query.reply(key(self.bench, "state"), self.content)

    def publish(self, **changes):
        """Publish the state; nothing any more once it is closed."""
        content = state_of(self.bench, **changes).to_json() if changes else self.content
        with suppress(zenoh.ZError):
            self.publisher.put(content)

    def publish_event(self, content):
        self.session.put(
            key(self.bench, "event"), content, congestion_control=zenoh.CongestionControl.BLOCK
        )

    def close(self):
        if not self.session.is_closed():
            self.session.close()


@contextmanager
def played(*names, **how):
    """Play the daemons of several benches for as long as the block runs."""
    with ExitStack() as stack:
        benches = []
        for name in names:
            bench = PlayedBench(name, **how)
            stack.callback(bench.close)
            benches.append(bench)
        yield benches


@contextmanager
def publishing(*benches, **changes):
    """Let benches publish their states again and again, as daemons do."""
    over = threading.Event()

    def publish():
        while not over.wait(0.05):
            for bench in benches:
                bench.publish(**changes)

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@contextmanager
def router(*connect):
    """Run a router that connects to endpoints; gives its own and its session."""
    listen = endpoint()
    with zenoh.open(router_config([listen], connect)) as session:
        yield listen, session


def await_answers(session, bench, count):
    """Wait until so many daemons of a name answer through a router's session."""
    deadline_s = time.monotonic() + PATIENCE_S
    every = {"target": zenoh.QueryTarget.ALL, "consolidation": zenoh.ConsolidationMode.NONE}
    while len(list(session.get(key(bench, "state"), **every))) < count:
        assert time.monotonic() < deadline_s, f"fewer than {count} daemons of {bench!r} answer"
