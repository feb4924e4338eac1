"""A small recording of each plan with several captures, from virtual time, to be analysed."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from motord.calibration import Calibration
from motord.config import packaged
from motord.experiments.plans import build
from motord.simulate import PlanSource, record_plan
from tests.campaigns.check_calibration import stated_calibration

SEED = 1
MESH = {"torques_Nm": [2.0, 4.0], "speeds_Hz": [0.8, 1.0], "turns": 4, "settle_s": 0.3}
PROFILE = "time_s,torque_Nm,speed_Hz\n0,0,0\n1,2,0.8\n3,2,0.8\n4,0,0\n"
INERTIA = {"schema": "motord.inertia/1", "inertia_kg_m2": 0.0105, "uncertainty_kg_m2": 1e-4}
EFFICIENCY = packaged("../../../config/efficiency.toml")


@dataclass(frozen=True)
class SmallPlan:
    """Settings of a plan of several captures; compensated: with a calibration in force.

    option: file that its analysis needs, "" for none.
    """

    plan: str
    settings: Mapping[str, Any]
    bench: Path | None = None
    compensated: bool = False
    option: str = ""


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
        {"torques_Nm": [2.0, 3.0], "speeds_Hz": [3.0, 6.0], "turns": 22, "settle_s": 0.3},
        bench=EFFICIENCY,
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
    "profile": SmallPlan("profile", {"repeats": 3}),
    "learn": SmallPlan("learn", {**MESH, "turns": 5}, compensated=True, option="calibration"),
}  # fmt: skip
"""By the name of the analysis."""


class PlanFiles:
    """Makes the recordings in a folder, each once, and the files that their analyses need."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: dict[str, Any] = {}

    @cached_property
    def _calibration(self) -> Calibration:
        return stated_calibration(SEED, PlanSource.of().config)

    def recording(self, name: str) -> Path:
        """Return the recording for an analysis."""
        one, path = PLANS[name], self._folder / f"{name}.mcap"
        if not path.exists():
            source, settings = PlanSource.of(one.bench), dict(one.settings)
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
