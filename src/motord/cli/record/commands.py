"""`motord record`: what is in a recording, a clean one out of a damaged one, tables out of one."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord.cli.common_options import AsJson, check_output_files, output_file
from motord.cli.console import fail_with, group, print_result, progress_bar, remark

if TYPE_CHECKING:
    from motord.importing.convert import Imported
    from motord.importing.survey import Progress

app = group("Look into recordings, export them, import others.")

RunFile = Annotated[
    Path, typer.Argument(metavar="RUN", help="A recording: .mcap, or .mcap.part if unfinished.")
]
RunFiles = Annotated[
    list[Path],
    typer.Argument(metavar="RUN...", help="Recordings: .mcap, or .mcap.part if unfinished."),
]

QUIET_S = 2.0
"""Time after which progress is shown."""


@app.command("import")
def import_recording(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A recording: CSV, TDMS or MDF.")],
    map_file: Annotated[
        Path, typer.Option("--map", metavar="MAP.toml", help="Which column is what.")
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="RUN.mcap", help="The recording to write.")
    ],
    strict: Annotated[
        bool, typer.Option("--strict", help="Fail if a row lacks something or its time is wrong.")
    ] = False,
    few_rows: Annotated[
        bool,
        typer.Option("--few-rows", help="Import even if more than half of the rows are left out."),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Make a run of a recording from elsewhere; most of `analyse` works on it."""
    from motord.importing.convert import import_run

    check_output_files({"--output": output}, [file, map_file], ["--output"])  # replaces none
    with _progress(silent=as_json) as progress:
        done = import_run(
            file, map_file, output, strict=strict, few_rows=few_rows, progress=progress
        )
    print_result(done.to_json(), "\n".join(_imported_lines(done)), as_json)


@app.command()
def info(
    runs: RunFiles,
    check: Annotated[
        bool,
        typer.Option(
            "--check",
            help="Read all of it, not only its index; end with 1 if something is missing.",
        ),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Report what a recording holds, and what is missing of it.

    Of several recordings --json prints a list; one that cannot be read does not keep the others
    from being reported.
    """
    from motord.recording.errors import RecordError
    from motord.recording.info import describe
    from motord.recording.reader import open_run

    known, errors = [], []
    for run in runs:
        try:
            facts = describe(open_run(run), check=check)
        except RecordError as error:
            errors.append(f"{error}")
            continue
        known.append(facts)
        if check and facts["damage"]:
            advice = "`motord record recover` writes a clean one of what is whole"
            errors.append(f"{run}: is damaged; {advice}")
    if known or len(runs) > 1:
        text = "\n\n".join("\n".join(_lines(facts)) for facts in known)
        print_result(known if len(runs) > 1 else known[0], text, as_json)
    fail_with(errors)


@app.command()
def recover(
    run: RunFile,
    output: Annotated[Path | None, output_file("Default: RUN.recovered.mcap.")] = None,
    as_json: AsJson = False,
) -> None:
    """Write a clean recording from a damaged or unfinished one."""
    from motord.recording import recovery
    from motord.recording.reader import open_run

    if open_run(run).check() is None:
        result: dict[str, Any] = {"file": str(run), "damage": None}
        text = f"{run} is whole: nothing to recover"
    else:
        done = recovery.recover(run, output or recovery.default_output(run))
        result = {
            "file": str(done.path),
            "ticks": done.ticks,
            "chunks": done.chunks,
            "damage": str(done.damage),
        }
        lost = done.damage.lines() if done.damage else []
        text = "\n".join([f"{done.path}: {done.ticks} ticks in {done.chunks} chunks", *lost])
    print_result(result, text, as_json)


@app.command()
def export(
    run: RunFile,
    output: Annotated[Path | None, output_file("A .csv (default), .parquet, .mf4 or .mat.")] = None,
    columns: Annotated[
        str | None,
        typer.Option(
            "--columns",
            metavar="A,B,...",
            help="Only these, in this order, those of the plan last.",
        ),
    ] = None,
    truth: Annotated[
        bool, typer.Option("--truth", help="What a simulated rig really did, not its ticks.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Write the ticks of a recording as a table: CSV, Parquet, MDF 4 or MATLAB."""
    from motord.recording.export import export as write
    from motord.recording.reader import open_run

    source = open_run(run)
    path = output or run.with_suffix(".csv")
    wanted = None if columns is None else [name.strip() for name in columns.split(",")]
    rows = write(source, path, wanted, truth=truth)
    damage = str(source.damage) if source.damage else None
    result = {"file": str(path), "rows": rows, "damage": damage}
    print_result(result, f"{path}: {rows} rows", as_json)
    if damage and not as_json:
        remark(source.missing)


def _lines(facts: dict[str, Any]) -> Iterator[str]:
    """Yield the facts as text, one a line."""
    points = facts["operating_points"]
    motor, plan, recovered = facts.get("motor"), facts.get("plan"), facts.get("recovered")
    shown = {
        "file": f"{facts['file']}, {facts['bytes'] / 1e6:.1f} MB in {facts['chunks']} chunks",
        "bench": facts.get("bench"),
        "motor": _motor(motor) if isinstance(motor, dict) else motor,
        "plan": plan.get("name", "") if isinstance(plan, dict) else plan,
        "calibration": _calibration(facts),
        "notes": facts.get("notes"),
        **_black_box(facts.get("blackbox")),
        "start": facts.get("start"),
        "ticks": _ticks(facts),
        "timing": facts["timing"]["words"] if facts["timing"] else None,
        "events": facts["events"],
        "channels": ", ".join(
            f"{c['name']} ({c['readings']} readings, {c['unit']})" for c in facts["channels"]
        ),
        "operating points": f"{len(points)}" if points else None,
        "recovered": recovered and f"from {recovered['from']}; lost: {recovered['missing']}",
        "missing": f"\n{'':18}".join(facts["losses"]) or "nothing",
    }
    for name, value in shown.items():
        if value not in (None, "", {}):
            yield f"{name + ':':18}{value}"
    for p in points:
        yield (
            f"  {p['index']:>3}  {p['torque_Nm']:8.5g} Nm {p['speed_Hz']:6.3f} Hz  "
            f"{p.get('turns') or 0:5.1f} turns  {p.get('quality', '')}"
        )


def _motor(motor: dict[str, Any]) -> str:
    serial = motor.get("serial")
    return f"{motor.get('name')}, serial {serial}" if serial else f"{motor.get('name')}"


def _calibration(facts: dict[str, Any]) -> str:
    """Return the calibration in force, and the serious findings that were accepted with it."""
    accepted = facts.get("calibration_findings")
    if not (accepted and isinstance(accepted, list)):
        return f"{facts.get('calibration') or ''}"
    return f"{facts.get('calibration')}, in spite of {', '.join(map(str, accepted))}"


def _black_box(account: object) -> dict[str, object]:
    """Return the lines of a black box: what happened, its causes, what to do."""
    if not isinstance(account, dict):
        return {}
    return {
        "black box of": account.get("reason"),
        "all causes": ", ".join(account.get("causes", [])),
        "suggested": account.get("action"),
    }


def _ticks(facts: dict[str, Any]) -> str:
    if not facts["ticks"]:
        return "none"
    text = f"{facts['ticks']} in {facts['duration_s']:.3f} s"
    if facts["rate_Hz"]:
        text += f" ({facts['rate_Hz']:.1f} Hz)"
    missing = facts["ticks_missing"]
    return text + (f", {missing} periods without a tick" if missing else "")


@contextmanager
def _progress(silent: bool) -> "Iterator[Progress]":
    """Give a function that shows the share of the work done, and when it will be, after a while."""
    bar = progress_bar("importing", "bar", "left", silent=silent, stderr=True, transient=True)
    task = bar.add_task("import", total=1.0)
    began_s = time.monotonic()

    def show(done: float) -> None:
        if not bar.live.is_started and time.monotonic() - began_s > QUIET_S:
            bar.start()
        bar.update(task, completed=done)

    try:
        yield show
    finally:
        if bar.live.is_started:
            bar.stop()


def _imported_lines(done: "Imported") -> Iterator[str]:
    yield (
        f"{done.path}: {done.ticks} ticks in {done.duration_s:.3f} s ({done.rate_Hz:.1f} Hz), "
        f"{done.missed} missing"
    )
    for point in done.points:
        yield (
            f"  {point['index']:>3}  {point['torque_Nm']:8.5g} Nm {point['speed_Hz']:6.3f} Hz  "
            f"{point['turns']:6.1f} turns  {point['quality']}"
        )
    yield from (f"- {text}" for text in done.notes)
    yield from (f"! {text}" for text in done.problems)
