"""`motord simulate`: a plan on the simulated rig in virtual time, into a recording."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord.cli.common_options import PlanSettings, ResultAsJson, bench_file, output_file
from motord.cli.console import explain_first_run, fail, print_result, progress_bar, remark

if TYPE_CHECKING:
    from motord.calibration import Calibration
    from motord.sequencing import Plan
    from motord.simulate import PlanSource

LONG_S = 3600.0
"""Time on the bench from which on it is said beforehand: half a minute or more to simulate."""


def simulate(
    name: Annotated[str, typer.Argument(help="The plan, such as calibrate or cogging.")],
    config: Annotated[
        Path | None, bench_file("Bench file; its rig is simulated whatever drivers it names.")
    ] = None,
    output: Annotated[Path | None, output_file("Default: the plan's name.", "RUN.mcap")] = None,
    settings: PlanSettings = None,
    calibration: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Calibration that the loop applies.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of noise and drift; default: the bench's.")
    ] = None,
    as_json: ResultAsJson = False,
) -> None:
    """Run a plan on the simulated rig, much faster than real time, and record it.

    Shows what a plan will do on this bench before it is run there, and makes recordings to try
    analyses on. The recording holds the truth of the simulation besides the ticks. Of plans in
    which somebody moves the rotor by hand, inertia-oscillation, the rig has to say how: the
    packaged inertia.toml has a bar on springs.
    """
    path = output or Path(f"{name}.mcap")
    if path.exists():
        fail(f"{path}: exists; name another file with -o, nothing is overwritten")
    explain_first_run(silent=as_json)  # before the imports, which make the folder of the kernels
    from motord.calibration import load
    from motord.simulate import PlanSource, require_room

    try:
        source = PlanSource.of(config)
        plan = _plan(source, name, settings or [])
        applied = load(calibration) if calibration else None
        if applied:
            applied.check_motor(source.config.motor)
        if applied is None and plan.settings.get("compensate", "off") != "off":
            fail(
                f"{plan.name} compensates, and no calibration is named; name one with "
                "--calibration, or --set compensate=off"
            )
        require_room(source.config, plan, path.absolute().parent)
        if plan.seconds >= LONG_S:
            _announce(source, plan)
        chosen = source.config.bench.seed if seed is None else seed
        result = _record(source, plan, path, chosen, applied, silent=as_json)
    except OSError as error:
        fail(f"{error.filename or path}: {error.strerror}")
    text = (
        f"{plan.name}: {result['points']} points, {result['bench_s']:.0f} s on the bench "
        f"took {result['wall_s']:.1f} s; wrote {path}"
    )
    if result["poor"]:
        are = "are" if result["poor"] > 1 else "is"
        text += f"; {result['poor']} {are} poor: `motord record info {path}` says why"
    print_result(result, text, as_json)


def _announce(source: "PlanSource", plan: "Plan") -> None:
    from motord.intervals import two_digits
    from motord.simulate import recorded_bytes

    gigabytes = recorded_bytes(source.config, plan) / 1e9
    remark(
        f"{plan.name}: about {two_digits(plan.seconds / 3600)} h on the bench; its recording takes "
        f"about {two_digits(gigabytes)} GB"
    )


def _plan(source: "PlanSource", name: str, given: list[str]) -> "Plan":
    from motord.cli.plan.settings import parse_settings
    from motord.experiments.plans import build

    defaults = source.config.plans.model_dump(mode="json", by_alias=True).get(name, {})
    return build(name, source.config, parse_settings(given, defaults))


def _record(
    source: "PlanSource",
    plan: "Plan",
    path: Path,
    seed: int,
    calibration: "Calibration | None",
    *,
    silent: bool,
) -> dict[str, Any]:
    from motord.simulate import record_plan
    from motord.virtual.mesh import processors

    began_s = time.monotonic()
    columns = "{task.description}", "bar", "left"
    with progress_bar(*columns, silent=silent) as bars, processors() as pool:
        task = bars.add_task(plan.name, total=1.0)
        recorded = record_plan(
            source, plan, path, seed, calibration, pool, lambda f: bars.update(task, completed=f)
        )
    return {
        "plan": plan.name,
        "run": str(path),
        "points": recorded.points,
        "poor": recorded.poor,
        "seed": seed,
        "bench_s": round(recorded.bench_s, 1),
        "wall_s": round(time.monotonic() - began_s, 2),
    }
