"""`motord plan preflight`: a plan on the simulated rig, before it is run on the bench."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord.cli.console import fail
from motord.cli.reach import ENDPOINT, AsJson, Bench, Connect, daemon, say

if TYPE_CHECKING:
    from motord.calibration import Calibration
    from motord.client import Client
    from motord.config import Config
    from motord.plans import Plan
    from motord.virtual.preflight import Forecast

LIMIT_S = 120.0


def preflight(
    name: Annotated[str, typer.Argument(help="The plan, as `motord plan list` names it.")],
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Change a setting, e.g. torques_Nm=1,3."),
    ] = None,
    limit_s: Annotated[
        float, typer.Option("--limit-s", min=1.0, help="Simulate no longer than that.")
    ] = LIMIT_S,
    bench: Bench = None,
    connect: Connect = ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Try a plan on the simulated rig: tell which points would trip or be poor, and why.

    Nothing moves. The rig is that of [bench] rig; without one, what the bench file says of motor,
    brake, sensor and inverter. It ends with 1 if a point would fail or could not be simulated.
    """
    from motord.config import ConfigError
    from motord.virtual.mesh import processors
    from motord.virtual.preflight import forecasts

    config, plan, calibration = _asked(name, settings or [], bench, connect)
    try:
        with processors() as pool:
            found = list(forecasts(config, plan, calibration, pool, limit_s))
    except ConfigError as error:
        fail(str(error))
    say([_as_dict(each) for each in found], "\n".join(map(_line, found)), as_json)
    bad = sum(not each.fine for each in found)
    if bad:
        fail(f"{bad} of {len(found)} points of {name} would fail, be poor or were not simulated")


def _asked(
    name: str, settings: list[str], bench: str | None, connect: str
) -> "tuple[Config, Plan, Calibration | None]":
    """Return the daemon's bench, the plan on it and the calibration in force if it needs one."""
    from motord.cli.settings import settings_of
    from motord.config import Config
    from motord.plans import PlanError, build

    with daemon(bench, connect) as client:
        config = Config.model_validate_json(json.dumps(client.rpc("config")["config"]))
        given = settings_of(client, name, settings)
        try:
            plan = build(name, config, given)
        except PlanError as error:
            fail(str(error))
        needed = plan.settings.get("compensate", "off") != "off"
        return config, plan, _calibration(client) if needed else None


def _calibration(client: "Client") -> "Calibration":
    from motord.calibration import CalibrationError, load

    view = client.state().calibration
    if view is None:
        fail("this plan compensates, but no calibration is installed; set compensate=off")
    try:
        return load(Path(view.path))
    except CalibrationError as error:
        fail(f"{error}; run this on the daemon's machine")


def _as_dict(each: "Forecast") -> dict[str, Any]:
    point = each.point
    return {
        "index": point.index,
        "torque_Nm": point.torque_Nm,
        "speed_Hz": point.speed_Hz,
        "simulated": each.simulated,
        "trouble": each.trouble,
        "quality": each.quality,
    }


def _line(each: "Forecast") -> str:
    said = each.trouble or each.quality
    if not each.simulated:
        said = "not simulated: no time left"
    return f"{each.point.index:4d}  {each.point.torque_Nm:g} Nm  {each.point.speed_Hz:g} Hz  {said}"
