"""`motord calibration`: calibration files, and which of them the daemon applies."""

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord.cli.bench.wording import tracked_lines
from motord.cli.calibration.export import export
from motord.cli.calibration.in_force import CalibrationFile, load_in_force
from motord.cli.common_options import AsJson, check_output_files, output_file
from motord.cli.connection_options import DEFAULT, Connection, Force, print_answer
from motord.cli.console import fail, group, print_result, remark

if TYPE_CHECKING:
    from motord.uncertainty_budget import Contribution

app = group("Calibration files: show, list, install, export for a drive, adopt what is tracked.")
app.command()(export)


@app.command()
def show(
    file: CalibrationFile = None,
    calibration_id: Annotated[
        str | None,
        typer.Option("--id", metavar="ID", help="Ask the daemon for one that it keeps."),
    ] = None,
    connection: Connection = DEFAULT,
    as_json: AsJson = False,
) -> None:
    """Check a calibration file, or that which the daemon applies, and show what is in it.

    Of the one in force also what is tracked, if tracking is enabled.

    With --id the daemon reads it, which may be on another machine; its JSON has 95 % intervals and
    at most 2048 values of the cogging torque.
    """
    from motord.calibration import load

    if calibration_id is not None:
        if file is not None:
            raise typer.BadParameter("give a file or --id")
        with connection.connect() as client:
            kept = client.rpc("calibration/show", id=calibration_id)
        print_result(kept, "\n".join(_lines(kept, kept["age"])), as_json)
        return
    seen: list[str] = []
    if file is not None:
        calibration = load(file)
    else:
        with connection.connect() as client:
            calibration = load_in_force(client)
            state = client.state()
            if state.tracking is not None:
                seen = tracked_lines(state.tracking, state.t_ns)
    content = calibration.to_json()
    text = _lines(content, calibration.age()) + seen
    print_result(content, "\n".join(text), as_json)


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
    rows = _kept(connection) if directory is None else _rows(directory)
    lines = [
        f"{' *'[row['in_force']]} {row['id']}  {row['age']} old  {row['motor']}  {row['file']}"
        for row in rows
    ]
    where = f"no calibration in {directory}" if directory else "no calibration is kept"
    print_result(rows, "\n".join(lines) or where, as_json)


def _kept(connection: Connection) -> list[dict[str, Any]]:
    """Return the calibrations that the daemon keeps, the newest first."""
    with connection.connect() as client:
        found = client.rpc("calibration/list")["calibrations"]
    return [
        {
            **{name: one[name] for name in ("id", "created", "age")},
            "motor": one["motor"]["name"],
            "method": one["method"],
            "file": one["path"],
            "in_force": one["in_force"],
        }
        for one in found
    ]


def _rows(directory: Path) -> list[dict[str, Any]]:
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
            "in_force": False,
        }
        for calibration, path in found
    ]


@app.command()
def install(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A calibration file.")],
    accept: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Apply it in spite of this serious finding."),
    ] = None,
    connection: Connection = DEFAULT,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Let the running daemon apply a calibration, now and after a restart.

    One with serious findings, whose data depart so far from the model that its intervals are too
    narrow, is refused unless each is accepted by name.
    """
    from motord.calibration import load
    from motord.cli.bench.lease_session import in_command

    calibration = load(file)
    with connection.connect() as client, in_command(client, force=force) as session:
        answer = session.commander.install_calibration(calibration, accept=accept or ())
    print_answer(answer.content(), f"{answer.id} is in force, kept in {answer.path}", as_json)


def _uncertainty_lines(budget: "list[Contribution]") -> list[str]:
    """Return the combined standard uncertainties as text."""
    from motord.intervals import two_digits
    from motord.uncertainty_budget import QUANTITIES, totals

    both = totals(budget)[2]
    sizes = [f"{name} {two_digits(value(both))} {unit}" for name, unit, value in QUANTITIES]
    return [
        f"uncertainty  {', '.join(sizes)}",
        "             (standard, Type A and B combined; the intervals above are of Type A alone)",
    ]


def _lines(c: dict[str, Any], age: str) -> list[str]:
    """Return the content of a calibration file, or the daemon's answer, as text."""
    from motord.calibration import CramerRao, Harmonic, half_widths
    from motord.calibration.parts import RmsSummary
    from motord.findings import Finding
    from motord.intervals import plus_minus
    from motord.report.text import mean_and_worst
    from motord.uncertainty_budget import Contribution, delta_epsilon_text

    motor = c["motor"]
    lines = [
        f"calibration  {c['id']}, {age} old ({datetime.fromisoformat(c['created']):%Y-%m-%d %H:%M} "
        "UTC)",
        f"motor        {motor['name']} {motor['serial']}: {motor['slots']} slots, "
        f"{2 * motor['pole_pairs']} poles, {motor['counts']} counts, "
        f"{motor['rated_torque_Nm']:g} Nm, {motor['connection']}",
        f"method       {c['method']}, condition number {c['condition_number']:.3g}",
        f"recordings   {', '.join(c['runs'])}",
    ]
    freedom = c.get("degrees_of_freedom") or {}
    alpha = half_widths(c["alpha_stderr"], freedom.get("alpha"))
    beta_A = half_widths(c["beta_stderr_A"], freedom.get("beta_A"))
    lines += [
        f"phase {'abc'[phase]}      alpha {plus_minus(c['alpha'][phase], alpha[phase])}, "
        f"beta {plus_minus(c['beta_A'][phase], beta_A[phase])} A"
        for phase in range(3)
    ]
    budget = [Contribution.model_validate(one) for one in c.get("budget") or ()]
    common = delta_epsilon_text(c["delta_epsilon"], c["delta_epsilon_source"], budget)
    lines.append(f"delta eps    {common}")
    if budget:
        lines += _uncertainty_lines(budget)
    lines += [
        f"order {h.order:4d}   {h.in_mNm()} mNm"
        + (f", phase {h.phase_text} rad" if h.phase_text else "")
        for h in (Harmonic.model_validate(one) for one in c["tau_cog_harmonics"])
    ]
    for name in ("before", "after"):
        if summary := c["rms_error_percent"][name]:
            text = mean_and_worst(RmsSummary.model_validate(summary))
            lines.append(f"RMS {name:<8} {text}")
    lines += [f"- {text}" for text in c["observable"]]
    if c.get("cramer_rao"):
        lines += [f"- {text}" for text in CramerRao.model_validate(c["cramer_rao"]).to_text()]
    lines += [f"- {Finding(**one).to_text()}" for one in c.get("findings") or ()]
    return lines


@app.command()
def adopt(
    output: Annotated[Path | None, output_file("Write the calibration, JSON, too.")] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show what is tracked against it; change nothing.")
    ] = False,
    accept: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="nothing-departed: adopt it though nothing has departed that can be adopted.",
        ),
    ] = None,
    connection: Connection = DEFAULT,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Put the calibration in force as it is tracked, now and after a restart.

    That takes [tracking] enabled = true in the bench file. Refused while no tracked quantity has
    left its interval that can be adopted, unless that is accepted: --accept nothing-departed.
    """
    from motord.calibration import CalibrationError, load
    from motord.cli.bench.lease_session import in_command
    from motord.experiments.tracking.tracked import NOT_IN_FORCE, TRACKING_OFF

    check_output_files({"--output": output}, [])
    with connection.connect() as client:
        state = client.state()
        if state.tracking is None:
            fail(TRACKING_OFF if state.calibration is not None else NOT_IN_FORCE)
        text = "\n".join(tracked_lines(state.tracking, state.t_ns))
        if dry_run:
            print_result(state.tracking.model_dump(mode="json"), text, as_json)
            return
        if not as_json:
            remark(text)
        with in_command(client, force=force) as session:
            answer = session.commander.adopt_calibration(accept=accept or ())
    if output is not None:
        try:
            load(Path(answer.path)).save(output)
        except CalibrationError as error:
            fail(f"{answer.id} is in force, kept in {answer.path}, but {error}")
    print_answer(answer.content(), f"{answer.id} is in force, kept in {answer.path}", as_json)
