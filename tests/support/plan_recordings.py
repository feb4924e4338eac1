"""A small recording of each plan with several captures, from virtual time, to be analysed."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from motord.calibration import Calibration
from motord.config import load, packaged
from motord.config.motor import PhaseOrder
from motord.config.text.editing import with_table, with_values
from motord.experiments.plans import build
from motord.rig.truth import RigTruth
from motord.simulate import PlanSource, record_plan
from tests.campaigns.check_calibration import stated_calibration
from tests.campaigns.estimator import rig

SEED = 1
MESH = {"torques_Nm": [2.0, 4.0], "speeds_Hz": [0.8, 1.0], "turns": 4, "settle_s": 0.3}
PROFILE = "time_s,torque_Nm,speed_Hz\n0,0,0\n1,2,0.8\n3,2,0.8\n4,0,0\n"
INERTIA = {"schema": "motord.inertia/1", "inertia_kg_m2": 0.0105, "uncertainty_kg_m2": 1e-4}
EFFICIENCY = packaged("../../../config/efficiency.toml")


@dataclass(frozen=True)
class SmallPlan:
    """Settings of a plan of several captures; compensated: with a calibration in force.

    option: file that its analysis needs, "" for none; rig: tables of the rig file that are changed.
    """

    plan: str
    settings: Mapping[str, Any]
    bench: Path | None = None
    compensated: bool = False
    option: str = ""
    rig: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


@dataclass(frozen=True)
class Mounting:
    """How encoder and cables are mounted on the same motor, in truth and as the bench file says."""

    counts: int = 4096
    direction: int = 1
    offset_rad: float = 0.0
    phase_order: PhaseOrder = "abc"

    def bench_keys(self) -> dict[str, Any]:
        """Return the keys of `[motor]` of a bench file."""
        return {
            "counts": self.counts, "encoder_direction": self.direction,
            "encoder_offset_rad": self.offset_rad, "phase_order": self.phase_order,
        }  # fmt: skip

    def rig_tables(self) -> dict[str, dict[str, Any]]:
        """Return the tables of a rig file."""
        encoder = {
            "counts": self.counts, "direction": self.direction, "offset_rad": self.offset_rad,
        }  # fmt: skip
        return {"encoder": encoder, "inverter": {"phase_order": self.phase_order}}

    def by_count(self, truth: RigTruth) -> RigTruth:
        """Return a rig whose cogging torque over the angle is that of `truth` over the counts."""
        waves = tuple(
            one.model_copy(update={"phase_rad": one.phase_rad + one.order * self.offset_rad})
            for one in truth.motor.cogging
        )
        motor = truth.motor.model_copy(update={"cogging": waves})
        return truth.model_copy(update={"motor": motor})


PLANS = {
    "align": SmallPlan("align", {"turns": 1, "rests": 17}),
    "calibrate": SmallPlan("calibrate", {**MESH, "speeds_Hz": [0.6, 0.8, 1.0]}),
    "verify": SmallPlan("verify", {**MESH, "compensate": "off"}),
    "check-calibration": SmallPlan(
        "check-calibration", {"turns": 5}, compensated=True, option="calibration"
    ),
    "cogging": SmallPlan("cogging", {"speeds_Hz": [0.8, 1.0], "turns": 4, "settle_s": 0.3}),
    "back-emf": SmallPlan("back-emf", {"speeds_Hz": [0.6, 0.9], "turns": 4, "settle_s": 0.3}),
    "torque-speed": SmallPlan(
        "torque-speed",
        {"torques_Nm": [2.0, 3.0], "speeds_Hz": [-3.0, 6.0], "turns": 22, "settle_s": 0.3},
        bench=EFFICIENCY,
    ),
    "thermal": SmallPlan(
        "thermal",
        {
            "steady_window_s": 2.0, "steady_K_per_min": 60.0, "heating_max_s": 9.0,
            "cooling_max_s": 6.0,
        },
        bench=packaged("../../../config/thermal.toml"),
        rig={"thermal": {"winding_J_per_K": 3.0, "magnet_J_per_K": 4.0, "housing_J_per_K": 4.0}},
    ),
    "inertia-oscillation": SmallPlan(
        "inertia-oscillation", {"repeats": 3}, bench=packaged("inertia.toml")
    ),
    "inertia": SmallPlan("inertia-acceleration", {"repeats": 3}),
    "friction": SmallPlan("friction", {"repeats": 4}, option="inertia"),
    "soak": SmallPlan(
        "soak",
        {
            "plan": "verify", "repeats": 4, "pause_s": 1.0, "compensate": "off",
            "inner": {"torques_Nm": [1.0, 2.0], "speeds_Hz": [1.0], "turns": 3, "settle_s": 0.3},
        },
    ),
    "sensitivity": SmallPlan(
        "sensitivity",
        {
            "turns": 3, "settle_s": 0.3, "alpha_a_steps": 5, "beta_a_steps": 3,
            "cogging_steps": 3, "delta_epsilon_steps": 3, "again_torques_Nm": [1.5, 4.5],
            "again_speeds_Hz": [0.6, 0.9],
        },
        compensated=True,
    ),
    "profile": SmallPlan("profile", {"repeats": 3}, compensated=True, option="calibration"),
    "learn": SmallPlan("learn", {**MESH, "turns": 5}, compensated=True, option="calibration"),
}  # fmt: skip
"""By the name of the analysis."""


PLAIN = Mounting()


class PlanFiles:
    """Makes the recordings in a folder, each once, and the files that their analyses need."""

    def __init__(self, folder: Path, mounting: Mounting = PLAIN) -> None:
        self._folder = folder
        self._mounting = mounting
        self._known: dict[str, Any] = {}

    @cached_property
    def _calibration(self) -> Calibration:
        truth, delta, epsilon = rig(SEED)
        made = self._mounting.by_count(truth), delta, epsilon
        return stated_calibration(SEED, self._source(PLANS["calibrate"]).config, made)

    def _source(self, one: SmallPlan) -> PlanSource:
        """Return the bench of a plan, with this mounting."""
        path = one.bench or packaged("sim.toml")
        rig_path = load(path).bench.rig
        assert rig_path is not None
        rig_text = rig_path.read_text()
        for table, values in (*one.rig.items(), *self._mounting.rig_tables().items()):
            rig_text = with_values(with_table(rig_text, table), table, values, rig_path.name)
        (self._folder / rig_path.name).write_text(rig_text)
        text = with_values(path.read_text(), "bench", {"rig": rig_path.name}, path.name)
        text = with_values(text, "motor", self._mounting.bench_keys(), path.name)
        (self._folder / path.name).write_text(text)
        return PlanSource.of(self._folder / path.name)

    def recording(self, name: str) -> Path:
        """Return the recording for an analysis."""
        one, path = PLANS[name], self._folder / f"{name}.mcap"
        if not path.exists():
            source, settings = self._source(one), dict(one.settings)
            if name == "profile":
                settings["file"] = str(self._folder / "profile.csv")
                Path(settings["file"]).write_text(PROFILE)
            plan = build(one.plan, source.config, settings)
            record_plan(source, plan, path, SEED, self._calibration if one.compensated else None)
        return path

    def options(self, name: str) -> dict[str, Path]:
        """Return the options that the analysis needs."""
        option = PLANS[name].option
        path = self._folder / f"{option}.json"
        if option == "calibration" and not path.exists():
            self._calibration.save(path)
        elif option == "inertia":
            path.write_text(json.dumps(INERTIA))
        return {option: path} if option else {}

    def known(self, name: str, make: Callable[[], Any]) -> Any:
        """Return what is made once for an analysis."""
        if name not in self._known:
            self._known[name] = make()
        return self._known[name]
