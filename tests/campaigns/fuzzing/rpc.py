"""Requests: every RPC of the daemon's core, in five states of the bench, over the virtual rig.

A request that is refused has a code and a message and has changed nothing. Without the token of the
lease in force nothing is ever changed but by those requests that need none.
"""

import json
import random
import tempfile
from pathlib import Path
from typing import Any, get_args

import numpy as np

from motord.api.errors import Code, RpcError
from motord.api.requests import RPCS, parse
from motord.config.experiments import plan_kinds
from motord.schema import Trip
from motord.service.bench.calibrations import CalibrationStore
from motord.service.rpc.calibration import Adoption, Installation
from motord.service.rpc.calibration_files import CalibrationFiles
from motord.service.rpc.calibration_reader import read, read_files
from motord.service.rpc.dispatcher import Call, Dispatcher
from motord.shm.run_directory import RunDir
from tests.campaigns.fuzzing.mutate import (
    ODD_NUMBERS,
    mutate_bytes,
    mutate_json,
    odd_value,
    some_bytes,
)
from tests.support.calibrations import calibration
from tests.unit.service.virtual_service import VirtualService

CODES = set(get_args(Code))
STATES = ("off", "enabled", "turning", "plan", "tripped")
FREE = {
    "lease/acquire", "stop", "note", "plan/start", "plan/list", "config", "calibration/list",
    "calibration/show", "queue/list",
}  # fmt: skip
"""Need no token: stop; a note; those that change nothing; a lease to be had; a plan's dry run."""
NEW_AFTER = 200
WAIT_STEPS = 400
GO_ON_STEPS = 5
NO_NUMBER = ("brake_temperature_C",)
"""nan where there is nothing to report."""


class Rpc:
    """Brings one request after another; `__call__` raises AssertionError for what must not be."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="motord-fuzz-")
        self._left = 0
        self._turn = 0
        self._calibration = calibration().to_json()

    def close(self) -> None:
        """Remove what was written."""
        self._folder.cleanup()

    def __call__(self, rng: random.Random) -> bool:
        if not self._left:
            self._begin()
        self._left -= 1
        name = rng.choice(sorted(RPCS))
        return self._bring(name, self._payload(rng, name))

    def _begin(self) -> None:
        self._left = NEW_AFTER
        service = self.service = VirtualService()
        store = CalibrationStore(service.config, Path(self._folder.name))
        self._installation = Installation(service.bench, store, lambda *tables: None, "text", read)
        self._store, kept = store, CalibrationFiles(store, read_files)
        adoption = Adoption(None, self._installation, store, RunDir("fuzz", store.directory))
        self._prepare = {
            "calibration/adopt": adoption.prepare,
            "calibration/install": self._installation.prepare,
            "calibration/list": kept.prepare_list,
            "calibration/show": kept.prepare_show,
            "plan/list": service.available.prepare,
            "plan/start": service.plans.make,
            "plan/resume": service.plans.read_remaining,
            "queue/add": service.queued.prepare_add,
        }
        service.dispatcher = Dispatcher(
            *(service.bench, service.operation, service.available, service.plans),
            *(service.queued, self._installation, kept, adoption),
        )
        self.token = service.acquire("fuzz")
        self._enter(STATES[self._turn % len(STATES)])
        self._turn += 1

    def _enter(self, state: str) -> None:
        service = self.service
        if state in ("enabled", "turning", "tripped"):
            service.ask("enable", token=self.token)
        if state == "turning":
            service.ask("set", token=self.token, torque_Nm=1.0, speed_Hz=0.5)
        if state == "plan":
            settings = {"torques_Nm": [1.0], "speeds_Hz": [0.5]}
            service.ask("plan/start", token=self.token, name="calibrate", settings=settings)
        if state == "tripped":
            memory = service.loop.virtual._memory
            memory["trip_bits"] = memory["first_trip"] = Trip.OVER_SPEED
        service.run_s(0.2, self.token)

    def _payload(self, rng: random.Random, name: str) -> bytes:
        if rng.random() < 0.1:
            return some_bytes(rng, 2000)
        content = self._right(rng, name)
        for _ in range(rng.choice((0, 1, 1, 1, 2, 4))):
            content = mutate_json(rng, content)
        payload = json.dumps(content).encode()
        return mutate_bytes(rng, payload) if rng.random() < 0.3 else payload

    def _right(self, rng: random.Random, name: str) -> dict[str, Any]:
        """Return a request of the right form, now and then with the right token."""
        token = rng.choice((self.token, self.token, "guess", "a" * 32))
        kind = rng.choice(sorted(plan_kinds()))
        own = getattr(self.service.config.plans, kind.replace("-", "_")).model_dump(mode="json")
        some = rng.sample(sorted(own), rng.randrange(min(4, len(own))))
        forms: dict[str, dict[str, Any]] = {
            "lease/acquire": {"holder": "fuzz", "force": rng.random() < 0.5},
            "stop": {"by": "fuzz"},
            "note": {"text": "a note", "by": "fuzz"},
            "set": {"token": token, **_values(rng)},
            "plan/start": {
                "name": kind,
                "token": token,
                "settings": {key: mutate_json(rng, own[key]) for key in some},
                "dry_run": rng.random() < 0.7,
            },
            "plan/list": {},
            "queue/list": {},
            "queue/add": {
                "token": token,
                "plans": [{"name": kind, "settings": {key: own[key] for key in some}}],
            },
            "queue/move": {"token": token, "id": rng.randrange(1, 4), "position": 1},
            "queue/remove": {"token": token, "ids": [rng.randrange(1, 4)]},
            "config": {},
            "calibration/list": {},
            "calibration/show": {"id": rng.choice(("", "0123", self._calibration["id"]))},
            "calibration/install": rng.choice(
                (
                    {"token": token, "calibration": mutate_json(rng, self._calibration)},
                    {"token": token, "path": str(odd_value(rng))},
                )
            ),
        }
        return forms.get(name, {"token": token})

    def _snapshot(self) -> tuple[Any, ...]:
        service = self.service
        bench, lease = service.bench, service.bench.lease
        return (
            bench.state,
            bench.setpoint.view().model_dump_json(),
            service.loop.setpoint.tobytes(),
            lease._held,
            bench.plans.active,
            bench.plans.view.model_dump_json() if bench.plans.view else None,
            bench.calibrated,
            service.bench.queue.model_dump_json(),
            self._store.current,
            service.restarts,
        )

    def _bring(self, name: str, payload: bytes) -> bool:
        before = self._snapshot()
        in_force = self.token
        try:
            if name in self._prepare:
                request, prepared = self._prepare[name](payload)
            else:
                request, prepared = parse(RPCS[name], payload), None
            call = Call(name, request, prepared)
            self.service.dispatcher.handle(call, self.service.now_ns)
        except RpcError as refusal:
            self._refused(refusal)
            assert self._snapshot() == before, "a request that was refused changed something"
            return False
        outcome = _outcome(call)
        waited = outcome is None
        for _ in range(WAIT_STEPS):
            if outcome is not None:
                break
            self.service.bench.lease._held.expires_ns = self.service.now_ns + 10**9
            self.service.step()
            outcome = _outcome(call)
        assert outcome is not None, f"{name} was never answered"
        if isinstance(outcome, RpcError):
            self._refused(outcome)
            assert waited or self._snapshot() == before, "refused, and yet something changed"
            return False
        json.dumps(outcome)
        given = getattr(request, "token", "")
        assert name in FREE or given == in_force, f"{name} was carried out without the lease"
        if name == "lease/acquire" or self.service.bench.lease._held is None:
            self.token = outcome.get("token") or self.service.acquire("fuzz", force=True)
        self._go_on()
        return True

    def _go_on(self) -> None:
        """Let some time pass with what was set: it must bring nothing down later either."""
        service = self.service
        service.bench.lease._held.expires_ns = service.now_ns + 10**9
        service.step(GO_ON_STEPS)
        assert abs(service.bench.setpoint.torque_Nm) <= service.config.limits.torque_Nm
        written = service.loop.setpoint[0]
        numbers = [written[n] for n in written.dtype.names if n not in NO_NUMBER]
        assert all(np.all(np.isfinite(n)) for n in numbers), f"set-point not finite: {written}"
        assert np.all(np.isfinite(service.bench.monitor.torque_set_Nm))

    def _refused(self, refusal: RpcError) -> None:
        assert refusal.code in CODES, f"unknown code {refusal.code}"
        assert refusal.message, "a refusal without a message"
        assert "Traceback" not in refusal.message


def _values(rng: random.Random) -> dict[str, float]:
    """Return set-points of any size, most of them within what a bench can do."""
    sizes = (
        lambda: rng.uniform(0, 1),
        lambda: rng.uniform(-3, 3),
        lambda: 10 ** rng.uniform(-320, 300),
        lambda: float(rng.choice(ODD_NUMBERS)),
    )
    keys = rng.sample(("torque_Nm", "speed_Hz", "brake", "drive_Hz"), rng.randint(1, 3))
    return {key: rng.choice(sizes)() for key in keys}


def _outcome(call: Call) -> Any:
    try:
        return call.wait(0).content()
    except RpcError as refusal:
        return None if refusal.code == "busy" else refusal
