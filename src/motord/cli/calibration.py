"""`motord calibration`: calibration files, and which of them the daemon applies."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord.cli.common_options import AsJson
from motord.cli.connection_options import DEFAULT, Connection, Force, print_answer
from motord.cli.console import fail, group, print_result

if TYPE_CHECKING:
    from motord.calibration import Calibration

app = group("Show calibration files, list those kept, install one.")


@app.command()
def show(
    file: Annotated[
        Path | None,
        typer.Argument(metavar="[FILE]", help="A calibration file; default: the one in force."),
    ] = None,
    connection: Connection = DEFAULT,
    as_json: AsJson = False,
) -> None:
    """Check a calibration file, or that which the daemon applies, and show what is in it."""
    from motord.calibration import load

    if file is None:
        with connection.open() as client:
            view = client.state().calibration
        if view is None:
            fail("no calibration is in force; name a file, or install one")
        file = Path(view.path)
    calibration = load(file)
    print_result(calibration.to_json(), "\n".join(_lines(calibration)), as_json)


@app.command("list")
def list_(
    directory: Annotated[
        Path | None,
        typer.Option("--dir", metavar="DIR", help="A folder with calibration files."),
    ] = None,
    connection: Connection = DEFAULT,
    as_json: AsJson = False,
) -> None:
    """List the calibrations that the daemon keeps, or those in a folder; * is in force."""
    in_force = ""
    if directory is None:
        with connection.open() as client:
            view = client.state().calibration
        if view is None:
            print_answer([], "no calibration is in force", as_json)
            return
        directory, in_force = Path(view.path).parent, view.id
    rows = _rows(directory, in_force)
    lines = [
        f"{' *'[row['in_force']]} {row['id']}  {row['age']} old  {row['motor']}  {row['file']}"
        for row in rows
    ]
    print_result(rows, "\n".join(lines) or f"no calibration in {directory}", as_json)


def _rows(directory: Path, in_force: str) -> list[dict[str, Any]]:
    """Return the calibrations in a folder, the newest first; other files are passed over."""
    from motord.calibration import CalibrationError, load

    if not directory.is_dir():
        fail(f"{directory}: no such folder on this machine")
    found = []
    for path in directory.glob("*.json"):
        try:
            found.append((load(path), path))
        except CalibrationError:
            continue
    found.sort(key=lambda pair: pair[0].created, reverse=True)
    return [
        {
            "id": calibration.id,
            "created": calibration.created.isoformat(),
            "age": calibration.age(),
            "motor": calibration.motor.name,
            "method": calibration.method,
            "file": str(path),
            "in_force": calibration.id == in_force,
        }
        for calibration, path in found
    ]


@app.command()
def install(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A calibration file.")],
    connection: Connection = DEFAULT,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Let the running daemon apply a calibration, now and after a restart."""
    from motord.calibration import load
    from motord.cli.bench.lease_session import in_command

    calibration = load(file)
    with connection.open() as client, in_command(client, force=force) as session:
        answer = session.commander.install_calibration(calibration)
    print_answer(answer.content(), f"{answer.id} is in force, kept in {answer.path}", as_json)


def _lines(c: "Calibration") -> list[str]:
    motor = c.motor
    lines = [
        f"calibration  {c.id}, {c.age()} old ({c.created:%Y-%m-%d %H:%M} UTC)",
        f"motor        {motor.name} {motor.serial}: {motor.slots} slots, {2 * motor.pole_pairs} "
        f"poles, {motor.counts} counts, {motor.rated_torque_Nm:g} Nm, {motor.connection}",
        f"method       {c.method}, condition number {c.condition_number:.3g}",
        f"recordings   {', '.join(c.runs)}",
    ]
    lines += [
        f"phase {'abc'[phase]}      alpha {c.alpha[phase]:.4f} +- "
        f"{1.96 * c.alpha_stderr[phase]:.4f}, beta {c.beta_A[phase]:+.4f} +- "
        f"{1.96 * c.beta_stderr_A[phase]:.4f} A"
        for phase in range(3)
    ]
    lines.append(f"delta eps    {c.delta_epsilon:.4f} ({c.delta_epsilon_source})")
    lines += [
        f"order {h.order:4d}   {1e3 * h.amplitude_Nm:.2f} +- {1.96e3 * h.stderr_Nm:.2f} mNm, "
        f"phase {h.phase_rad:+.3f} rad"
        for h in c.tau_cog_harmonics
    ]
    for name, summary in (
        ("before", c.rms_error_percent.before),
        ("after", c.rms_error_percent.after),
    ):
        if summary is not None:
            lines.append(f"RMS {name:<8} {summary.mean:.2f} % mean, {summary.max:.2f} % worst")
    lines += [f"- {words}" for words in c.observable]
    return lines
