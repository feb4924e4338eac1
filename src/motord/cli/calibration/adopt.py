"""`motord calibration adopt`: put the calibration in force as it is tracked."""

from pathlib import Path
from typing import Annotated

import typer

from motord.cli.bench.wording import tracked_lines
from motord.cli.common_options import AsJson
from motord.cli.connection_options import DEFAULT, Connection, Force, print_answer
from motord.cli.console import fail, print_result, remark


def adopt(
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Write the calibration, JSON, too."),
    ] = None,
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
    from motord.api.tracking_messages import NOT_IN_FORCE, TRACKING_OFF
    from motord.calibration import CalibrationError, load
    from motord.cli.bench.lease_session import in_command

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
