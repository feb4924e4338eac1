"""`motord learn`: the passes of learning on a running daemon, one after the other."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord.cli.analysis_command import Output, Report, print_files, print_text
from motord.cli.bench.lease_session import in_command
from motord.cli.calibration.in_force import load_in_force
from motord.cli.common_options import AsJson, PlanSettings, check_output_files
from motord.cli.connection_options import DEFAULT, Connection, Force
from motord.cli.console import fail, print_json, print_line
from motord.cli.plan.commands import closed_recording, follow
from motord.cli.plan.settings import settings_of

if TYPE_CHECKING:
    from motord.calibration import Calibration
    from motord.client import Commander
    from motord.experiments.ilc.analysis import LearnPass
    from motord.experiments.ilc.estimate import Learning


def learn(
    passes: Annotated[
        int, typer.Option(min=2, max=50, help="Passes at most; the last one only measures.")
    ] = 5,
    settings: PlanSettings = None,
    gain: Annotated[
        float, typer.Option(min=0.05, max=1.0, help="Share of the error to take out in a pass.")
    ] = 0.7,
    highest_order: Annotated[
        int, typer.Option(min=1, help="Highest order to learn, as far as the loop's rate allows.")
    ] = 256,
    again: Annotated[
        bool, typer.Option("--again", help="Learn on at points that had settled before.")
    ] = False,
    output: Output = None,
    report: Report = None,
    connection: Connection = DEFAULT,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Learn the residual torque ripple of the calibration in force, and apply it.

    Each pass is a run of the plan `learn`; what it teaches is installed before the next, with the
    bench at rest. Ctrl-C aborts the pass, ramping down; what the passes before taught stays.
    """
    from datetime import UTC, datetime

    from motord.experiments.ilc.analysis import finish, reopen
    from motord.experiments.ilc.command import summary, text
    from motord.experiments.ilc.estimate import Learning

    check_output_files({"--output": output, "--report": report}, [])
    learning = Learning(gain=gain, highest_order=highest_order)
    with connection.connect() as client, in_command(client, force=force) as session:
        calibration = load_in_force(
            client, "no calibration is in force; learning goes on from one: install one first"
        )
        chosen = settings_of(client, "learn", settings or [])
        if again:
            calibration = reopen(calibration, datetime.now(UTC), learning)
            _install(session.commander, calibration)
        for number in range(1, passes + 1):
            done = _pass(session.commander, chosen, calibration, learning, quiet=as_json)
            for finding in done.limited():
                why = f"{finding.meaning}; {finding.action}"
                fail(f"pass {number}: {why}; calibration {calibration.id} stays in force")
            if number == passes:
                done = finish(done, datetime.now(UTC))
            calibration = done.calibration
            _install(session.commander, calibration)
            if not as_json:
                print_line(f"pass {number}: {summary(done)}")
            if done.finished:
                break
        if output:
            calibration.save(output)
        if report:
            from motord.experiments.ilc.report import report as page_of

            page_of(done).write(report)
    if as_json:
        print_json(done.to_json())
    else:
        print_text(text(done))
        print_files(output, report)


def _pass(
    commander: "Commander",
    settings: dict[str, Any],
    calibration: "Calibration",
    learning: "Learning",
    *,
    quiet: bool,
) -> "LearnPass":
    """Run the plan once and learn from its recording."""
    from datetime import UTC, datetime

    from motord.experiments.ilc.analysis import learn_from_runs
    from motord.experiments.subject import Subject
    from motord.recording.reader import open_run

    run_once = commander.run_plan("learn", settings)
    view = follow(run_once, commander.abort_plan, quiet=quiet)
    if view.state != "done":
        fail(f"learn {view.state}: {view.message}; calibration {calibration.id} is in force")
    run = open_run(closed_recording(view))
    now = datetime.now(UTC)
    return learn_from_runs([run], Subject.of_runs([run]), calibration, now, learning)


def _install(commander: "Commander", calibration: "Calibration") -> None:
    """Install what was learned on top of the calibration in force, whose findings are accepted."""
    commander.install_calibration(calibration, accept=calibration.serious_names)
