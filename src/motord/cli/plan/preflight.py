"""A plan on the simulated rig, before it is run on the bench: part of a dry run."""

import json
from typing import TYPE_CHECKING, Any

from motord.cli.calibration.in_force import load_in_force
from motord.cli.console import fail

if TYPE_CHECKING:
    from motord.calibration import Calibration
    from motord.client import Client
    from motord.virtual.preflight import Forecast

LIMIT_S = 120.0
ON_ITS_MACHINE = "run this on the daemon's machine, or with --limit-s 0"


def predict(
    client: "Client", name: str, settings: dict[str, Any], limit_s: float
) -> "list[Forecast]":
    """Return what would become of each point of a plan that the daemon has found to be possible.

    The rig is that of [bench] rig; without one, what the bench file says of motor, brake, sensor
    and inverter. Nothing is simulated for longer than `limit_s`.
    """
    from pydantic import ValidationError

    from motord.config import Config, ConfigError
    from motord.experiments.plans import build
    from motord.section.complaints import wrong_things
    from motord.sequencing import PlanError
    from motord.virtual.mesh import processors
    from motord.virtual.preflight import forecasts

    try:
        config = Config.model_validate_json(json.dumps(client.config().config))
    except ValidationError as error:
        wrong = "; ".join(wrong_things(error))
        fail(
            f"not simulated: this motord cannot read the daemon's bench ({wrong}); {ON_ITS_MACHINE}"
        )
    try:
        plan = build(name, config, settings)
        compensates = plan.settings.get("compensate", "off") != "off"
        calibration = _calibration(client) if compensates else None
        with processors() as pool:
            return list(forecasts(config, plan, calibration, pool, limit_s))
    except (ConfigError, PlanError) as error:
        fail(f"not simulated: {error}")


def _calibration(client: "Client") -> "Calibration":
    from motord.calibration import CalibrationError

    try:
        return load_in_force(
            client, "not simulated: this plan compensates, but no calibration is installed any more"
        )
    except CalibrationError as error:
        fail(f"not simulated: {error}; {ON_ITS_MACHINE}")


def as_dict(each: "Forecast") -> dict[str, Any]:
    """Return a forecast as JSON has it."""
    shown = {name: getattr(each, name) for name in ("simulated", "trouble", "quality")}
    return {"index": each.point.index, **shown}


def forecast_text(each: "Forecast") -> str:
    """Return what would become of a point."""
    if not each.simulated:
        return f"not simulated: {each.trouble or 'no time left'}"
    return each.trouble or each.quality


def warning(found: "list[Forecast]", name: str) -> str:
    """Return what stands against the plan, "" if nothing does."""
    bad = sum(each.simulated and not each.fine for each in found)
    left = sum(not each.simulated and not each.trouble for each in found)
    parts = [f"{bad} of {len(found)} points of {name} would fail or be poor"] if bad else []
    parts += [f"{left} were not simulated: give it more time by --limit-s"] if left else []
    return "; ".join(parts)
