"""`motord new`: a first bench file, by questions or by options."""

import inspect
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord.bench_file.questions import QUESTIONS, Question
from motord.bench_file.templates import CHECK, INVERTERS, TEMPLATES
from motord.cli.common_options import AsJson, Overwrite, check_output_files
from motord.cli.console import fail, print_result, remark

if TYPE_CHECKING:
    from motord.config import Config

File = Annotated[Path, typer.Argument(metavar="FILE", help="The bench file to write.")]
TemplateOption = Annotated[
    str,
    typer.Option("--template", metavar="NAME", help=f"What it begins as: {', '.join(TEMPLATES)}."),
]
InverterOption = Annotated[
    str,
    typer.Option(
        "--inverter", metavar="NAME", help=f"Inverter of a real bench: {', '.join(INVERTERS)}."
    ),
]
Yes = Annotated[bool, typer.Option("--yes", "-y", help="Ask nothing: defaults for the rest.")]


def _new(
    file: File,
    template: TemplateOption = "",
    inverter: InverterOption = "",
    yes: Yes = False,
    force: Overwrite = False,
    as_json: AsJson = False,
    **named: str | None,
) -> None:
    """Write a bench file with a comment for each key: asks on a terminal, or takes options.

    What is not answered has the example's value, marked CHECK for a real bench. The file is
    checked before it is written.
    """
    from motord.bench_file.commented import new_bench_file

    if file.exists() and not force:
        fail(f"{file}: is there already; name another file, or say --force to write over it")
    check_output_files({"FILE": file}, [], ["FILE"])
    answers = {q.key: text for q in QUESTIONS if (text := named[_parameter(q)]) is not None}
    if yes or as_json or not sys.stdin.isatty():
        if not template:
            fail(f"--template is needed where nobody is asked: {', '.join(TEMPLATES)}")
        text, bench = new_bench_file(template, inverter, answers, None, file)
    else:
        template, text, bench = _by_questions(file, template, inverter, answers)
    _write(file, template, text, bench, as_json)


def _by_questions(
    file: Path, template: str, inverter: str, answers: Mapping[str, str]
) -> tuple[str, str, "Config"]:
    """Ask until the answers make a bench; what was said before is the next default.

    What the options say is asked for, too, once it does not go together.
    """
    from motord.bench_file.commented import new_bench_file
    from motord.config import ConfigError

    template = template or _choose("Which bench", {n: t.summary for n, t in TEMPLATES.items()})
    if template in TEMPLATES and TEMPLATES[template].real:
        inverter = inverter or _choose("Inverter", INVERTERS)
    given: dict[str, str] = {}

    def ask(question: Question, default: str) -> str:
        given[question.key] = _prompt(question, given.get(question.key, default))
        return given[question.key]

    while True:
        try:
            return template, *new_bench_file(template, inverter, answers, ask, file)
        except ConfigError as error:
            if not given:  # options alone are wrong
                raise
            remark(f"This does not go together: {error}\nOnce more; Enter keeps an answer.")
            given.update(answers)
            answers = {}


def _choose(prompt: str, choices: Mapping[str, str]) -> str:
    width = max(map(len, choices))
    for name, summary in choices.items():
        remark(f"  {name:<{width}}  {summary}")

    def checked(text: str) -> str:
        if text not in choices:
            raise typer.BadParameter(f"one of {', '.join(choices)}")
        return text

    return str(typer.prompt(prompt, default=next(iter(choices)), value_proc=checked, err=True))


def _prompt(question: Question, default: str) -> str:
    from motord.bench_file.parsing import parse
    from motord.config import ConfigError

    def checked(text: str) -> str:
        try:
            parse(question, text)
        except ConfigError as error:
            raise typer.BadParameter(str(error)) from None
        return text

    prompt = question.prompt + (f" ({', '.join(question.choices)})" if question.choices else "")
    return str(typer.prompt(prompt, default=default, value_proc=checked, err=True))


def _write(file: Path, template: str, text: str, bench: "Config", as_json: bool) -> None:
    from motord.atomic_write import write_whole

    write_whole(file, text)
    to_check = text.count(f"# {CHECK}")
    steps = [step.format(file=shlex.quote(str(file))) for step in TEMPLATES[template].next_steps]
    lines = [f"wrote {file}: bench {bench.bench.name}, {TEMPLATES[template].summary}"]
    if to_check:
        lines.append(f"{to_check} values are an example's: look for {CHECK} in it")
    lines += ["next:", *(f"  {step}" for step in steps)]
    result = {
        "file": str(file), "bench": bench.bench.name, "template": template,
        "to_check": to_check, "next": steps,
    }  # fmt: skip
    print_result(result, "\n".join(lines), as_json)


def _parameter(question: Question) -> str:
    return question.key.replace(".", "_")


def _with_questions(command: Any) -> Any:
    """Give `command` an option for each question."""
    own = [p for p in inspect.signature(command).parameters.values() if p.name != "named"]
    asked = [
        inspect.Parameter(
            _parameter(question),
            inspect.Parameter.KEYWORD_ONLY,
            default=None,
            annotation=Annotated[
                str | None,
                typer.Option(
                    question.option,
                    metavar="|".join(question.choices) or "VALUE",
                    help=question.prompt,
                ),
            ],
        )
        for question in QUESTIONS
    ]
    parameters = [one.replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in own] + asked
    command.__signature__ = inspect.Signature(parameters)
    command.__annotations__ = {one.name: one.annotation for one in parameters}
    return command


new = _with_questions(_new)
