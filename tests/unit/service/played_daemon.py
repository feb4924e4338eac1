"""The whole daemon but for its processes, which are played by the test, and for Zenoh."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from motord import config
from motord.api.requests import RPCS, parse
from motord.loop.rt_setup import RealtimeStatus
from motord.loop.status import LoopPhase, LoopStatus
from motord.schema import TICK_DTYPE, State, as_bytes
from motord.service import build as service
from motord.service.host.systemd import Notifier
from motord.service.processes import PROCESSES
from motord.service.rpc.dispatcher import Call
from motord.service.rpc.plans import PlanControl
from motord.shm.mailbox import MailboxReader
from motord.shm.ring import RingWriter, capacity_for
from motord.shm.run_directory import RunDir
from motord.shm.tables import TablesReader
from motord.unix_clock import Clock
from tests.unit.service.virtual_service import packaged_bench


class Played:
    """A process that the test plays."""

    pid = 4711

    def __init__(self):
        self.code = None
        self.signals = []

    def poll(self):
        return self.code

    def wait(self, timeout=None):
        return self.code

    def send_signal(self, sig):
        self.signals.append(sig)
        self.code = -sig


class PlayedLoop(Played):
    """Publishes ticks on command."""

    def __init__(self, run_dir, bench_config):
        super().__init__()
        self.run_dir = run_dir
        self.ring = RingWriter(run_dir.ring, capacity_for(bench_config.loop))
        self.mailbox = MailboxReader(run_dir.setpoint)
        self.tables = TablesReader(run_dir.tables)
        self.number = 0

    def ready(self):
        status = RealtimeStatus(
            items=[], kernel="k", preemption="p", rt_runtime_us=0, rt_period_us=0, isolated_cpus=""
        )
        LoopStatus(phase=LoopPhase.READY, pid=1, realtime=status).write(self.run_dir.loop_status)

    def fail(self, error):
        LoopStatus(phase=LoopPhase.FAILED, pid=1, error=error).write(self.run_dir.loop_status)
        self.code = 1

    def tick(self, state=State.OFF, count=1):
        self.tables.poll()
        block = np.zeros(count, TICK_DTYPE)
        block["tick"] = np.arange(self.number, self.number + count)
        block["state"], block["plan_point"] = state, -1
        self.number += count
        slots = as_bytes(self.ring.records)
        for row in as_bytes(block):
            slots[self.ring.index] = row
            self.ring.publish()


class PlayedPipes(Played):
    """A child behind pipes; `received` returns its commands."""

    def __init__(self, pid):
        super().__init__()
        self.pid = pid
        commands, self._into = os.pipe()
        self._out_of, reports = os.pipe()
        self.stdin, self.stdout = os.fdopen(self._into, "wb", 0), os.fdopen(self._out_of, "rb", 0)
        self._commands, self._reports = os.fdopen(commands, "rb", 0), os.fdopen(reports, "wb", 0)
        os.set_blocking(commands, False)
        self._rest = b""

    def received(self, do=None):
        return [c for c in self._whole_lines() if do in (None, c["do"])]

    def _whole_lines(self):
        *lines, self._rest = (self._rest + (self._commands.read() or b"")).split(b"\n")
        return [json.loads(line) for line in lines]

    def send(self, message):
        self._reports.write(json.dumps(message).encode() + b"\n")

    def close(self):
        for pipe in (self._commands, self._reports, self.stdin, self.stdout):
            pipe.close()


class PlayedRecorder(PlayedPipes):
    """A recorder."""

    def report(self, **report):
        self.send({"recording": True, "error": "", **report})


class PlayedDaemon:
    """An assembled daemon whose time the test steps."""

    def __init__(self, folder, monkeypatch, **changes):
        base = packaged_bench().model_dump()
        base["bench"].update(name="played")
        for section, values in changes.items():
            base[section].update(values)
        self.config = config.Config.model_validate(base)
        self.folder = folder
        self.run_dir = RunDir("played", folder)
        self.run_dir.create()
        self.loops, self.recorders, self.estimators, self.trackers = [], [], [], []
        self.spawn = {
            "loop": self._spawn_loop,
            "recorder": self._spawn_recorder,
            "estimator": self._spawn_estimator,
            "tracker": self._spawn_tracker,
        }
        played = [
            replace(row, spawn=lambda command, name=row.name: self.spawn[name](command))
            for row in PROCESSES
        ]
        monkeypatch.setattr(service, "PROCESSES", played)
        monkeypatch.chdir(folder)
        self.supervisor = service.build(
            self.config, "the text", Path("/bench.toml"), self.run_dir, folder, Clock(0), Notifier()
        ).supervisor
        self.now_ns = 1_000_000_000_000
        self.supervisor.clock_ns = lambda: self.now_ns

    def _spawn_loop(self, command):
        self.loops.append(PlayedLoop(self.run_dir, self.config))
        return self.loops[-1]

    def _spawn_recorder(self, command):
        self.recorders.append(PlayedRecorder(100 + len(self.recorders)))
        return self.recorders[-1]

    def _spawn_estimator(self, command):
        self.estimators.append(PlayedPipes(200 + len(self.estimators)))
        return self.estimators[-1]

    def _spawn_tracker(self, command):
        self.trackers.append(PlayedPipes(300 + len(self.trackers)))
        return self.trackers[-1]

    def up(self):
        self.supervisor.start()
        self.loops[-1].ready()
        self.step()
        self.recorders[-1].report(recording=False)
        self.step()

    def begin_plan(self):
        """Begin a plan that is recorded; return the token and the recorder's command to start."""
        self.up()
        token = self.ask("lease/acquire", holder="anna")["token"]
        self.ask("plan/start", token=token, name="calibrate")
        [start] = self.recorders[0].received("start")
        self.recorders[0].report(file=f"{start['out']}-000.mcap")
        self.step(2)
        return token, start

    def record(self):
        """Be enabled, so that it is recorded; return the recorder's command to start."""
        self.step(2, State.ENABLED)
        [start] = self.recorders[-1].received("start")
        self.recorders[-1].report(file=f"{start['out']}-000.mcap")
        return start

    def step(self, steps=1, state=State.OFF, every_ms=10):
        for _ in range(steps):
            self.now_ns += every_ms * 1_000_000
            if self.loops and self.loops[-1].code is None:
                self.loops[-1].tick(state, 2 * every_ms)
            self.supervisor.step()

    def wait_s(self, seconds, state=State.OFF):
        """Let time pass in which nothing but time matters, in fewer steps."""
        self.step(round(seconds / 0.05), state, every_ms=50)

    def bring(self, name, /, **arguments):
        payload, prepared = json.dumps(arguments).encode(), None
        if name == "plan/start":  # a thread of the intake makes the plan
            bench = self.supervisor.bench
            _, prepared = PlanControl(bench, bench.plans).make(payload)
        call = Call(name, parse(RPCS[name], payload), prepared)
        self.supervisor.dispatcher.calls.put(call)
        return call

    def ask(self, name, /, **arguments):
        call = self.bring(name, **arguments)
        self.step(2)
        return call.wait(0).content()

    def messages(self):
        return [e.message for e in self.supervisor.bench.events.recent()]

    def state(self):
        return json.loads(self.supervisor.publisher.documents["state"]())

    def close(self):
        for child in self.recorders + self.estimators + self.trackers:
            child.close()


def end_after(loop, state):
    """Let a loop publish ticks after the supervisor saw it running, and then end."""

    def poll():
        if loop.code is None:
            loop.tick(state, 20)
            loop.code = -9
        return loop.code

    loop.poll = poll
