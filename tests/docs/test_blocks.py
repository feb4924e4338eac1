"""Every block of README and docs is read or run, or listed with the reason why not."""

import re
import shlex
import tomllib
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import typer

from motord import config
from motord.api.queue_messages import QueuedPlans
from motord.cli import app
from motord.cli.plan.settings import parse_settings
from motord.config import Config
from motord.config.experiments import GROUP, plan_kinds
from motord.config.faults import Timeline
from motord.experiments.plans import build
from motord.importing.mapping import ImportMap
from motord.verdict.motor_type import MotorType
from tests.docs.blocks import (
    COMMANDS,
    FOLLOWED,
    LISTED,
    PRINTED,
    PROGRAMS,
    READ_BY,
    ROOT,
    RUN,
    Block,
    blocks,
    commands,
    named,
    of,
    pages,
)

KEPT_HERE = ("config/", "systemd/", "tests/", "docs/", "tools/")
"""Folders whose files a command may name: they have to be there."""


def test_every_block_is_read_run_or_listed() -> None:
    for block in blocks():
        where = f"{named(block)}: a block of {block.language or 'no language'}"
        if block.file.startswith(FOLLOWED) and block.language in ("python", "diff"):
            continue
        if block.language == "python":
            assert block.key in RUN, f"{where} is not run: put it into RUN"
        elif block.language not in ("toml", *COMMANDS):
            assert block.file in LISTED.get(block.language, {}), f"{where} is not listed"


def test_commands_are_in_blocks_that_say_so() -> None:
    """Indented text is for formulas: nothing would read a command there."""
    for page in pages():
        assert not re.search(r"^    (\$ |motord |make |python|sudo )", page.read_text(), re.M), page


def test_nothing_is_listed_that_is_not_there() -> None:
    found = blocks()
    assert {block.key for block in of("python")} == set(RUN) == set(PRINTED)
    for language, files in LISTED.items():
        for file in files:
            assert any(b.language == language and b.file == file for b in found), (language, file)
    for file, first in READ_BY:
        assert any(b.file == file and b.first.startswith(first) for b in found), (file, first)


def kind_of(block: Block) -> str:
    kinds = [
        kind
        for (file, first), kind in READ_BY.items()
        if file == block.file and block.first.startswith(first)
    ]
    return kinds[0] if kinds else "bench"


def bench_with(tables: dict[str, Any]) -> Config:
    """Return the packaged bench with these tables: devices replaced, others changed."""
    whole = tomllib.loads(config.packaged("sim.toml").read_text())
    devices = tables.keys() & {"inverter", "bridge"}
    if devices:  # a rig is simulated in whole or not at all
        whole = tomllib.loads((ROOT / "config" / "bench.toml").read_text())
    if tables.get("inverter", {}).get("driver") == "can-dq":
        whole["motor"]["connection"] = "star"
    for name, table in tables.items():
        keep = name in whole and name not in devices and isinstance(table, dict)
        whole[name] = {**whole[name], **table} if keep else table
    path = ROOT / "config" / "bench.toml" if devices else config.packaged("sim.toml")
    return Config.model_validate(whole, context={"folder": path.parent})


@pytest.mark.parametrize("block", of("toml"), ids=named)
def test_toml_is_valid(block: Block) -> None:
    tables = tomllib.loads(block.text)
    kind = kind_of(block)
    if kind == "faults":
        assert Timeline.model_validate(tables).fault
    elif kind == "map":
        assert ImportMap.model_validate(tables).columns
    elif kind == "queue":
        assert QueuedPlans.model_validate(tables).plan
    elif kind == "motor type":
        assert MotorType.model_validate(tables).plan
    elif kind == "experiments":
        [[group, experiments]] = tables["project"]["entry-points"].items()
        assert group == GROUP
        [example] = experiments.items()
        assert example == ("spin_down", "spin_down:EXPERIMENT")  # as test_external.py announces it
        assert (ROOT / "tests/unit/experiments/external/spin_down/__init__.py").exists()
    elif kind == "entry points":
        from motord.config.driver_names import DRIVERS

        [[group, drivers]] = tables["project"]["entry-points"].items()
        assert group == DRIVERS
        assert all(re.fullmatch(r"(inverter|bridge|brake|drive)\.\w+", name) for name in drivers)
    else:
        assert bench_with(tables).motor


def parse(arguments: list[str]) -> list[str]:
    """Parse a command line as `motord` would, without carrying it out; return the commands' names.

    Raises what the parser raises: no such command, no such option, an argument that is missing.
    """
    command: Any = typer.main.get_command(app)
    context, names = None, []
    while True:
        name = names[-1] if names else "motord"
        context = command.make_context(name, list(arguments), parent=context)
        if not hasattr(command, "commands") and not hasattr(command, "resolve_command"):
            return names
        left = [*getattr(context, "_protected_args", []), *context.args]
        found, command, arguments = command.resolve_command(context, left)
        names.append(found)


def settings_of(arguments: list[str]) -> dict[str, Any]:
    """Return what `--set key=value` says; several values are a list."""
    places = (at for at, argument in enumerate(arguments) if argument == "--set")
    return parse_settings([arguments[at + 1] for at in places], {})


def bench_file(arguments: list[str]) -> Path | None:
    """Return the file of `-c`, or that of config/ with the name of `--bench`, if there is one."""
    given = dict(pairwise(arguments))
    named = ROOT / given.get("-c", f"config/{given.get('--bench')}.toml")
    return named if named.exists() else None


def check_motord(arguments: list[str]) -> None:
    names = parse(arguments)
    if names[:2] in (["plan", "start"], ["simulate"]) or names[:1] == ["simulate"]:
        plan = arguments[len(names)]
        assert plan in plan_kinds(), f"no plan {plan}"
        build(plan, config.load(bench_file(arguments)), settings_of(arguments))


def check_make(arguments: list[str], folder: Path) -> None:
    folder = ROOT / arguments[arguments.index("-C") + 1] if "-C" in arguments else folder
    files = (folder / "Makefile", *folder.glob("boards/*.mk"))
    makefile = "".join(path.read_text() for path in files)
    targets = [w for at, w in enumerate(arguments) if w != "-C" and arguments[at - 1] != "-C"]
    for target in targets:
        if "=" not in target:
            rule = rf"^(?:[\w-]+ )*{re.escape(target)}(?: [\w-]+)* *:"
            assert re.search(rule, makefile, re.M), f"no target {target}"


def check(command: str, folder: Path = ROOT) -> None:
    """Raise AssertionError for a command that cannot be meant as it stands in a folder."""
    arguments = shlex.split(command)
    while re.fullmatch(r"[A-Z_]+=.*", arguments[0]):
        arguments = arguments[1:]
    program, *rest = arguments
    program = "motord" if program.endswith("/motord") else program
    for argument in rest:
        if argument.startswith(KEPT_HERE):
            assert (ROOT / argument).exists(), f"{argument} is not there"
    if program == "motord":
        try:
            check_motord(rest)
        except typer.Exit:
            pass
        except Exception as error:
            text = getattr(error, "message", None) or str(error)
            raise AssertionError(f"{command}: {text}") from error
    elif program == "make":
        check_make(rest, folder)
    elif Path(program).name != "pytest":
        assert program in PROGRAMS, f"{program}: neither a command that is read nor listed"


@pytest.mark.parametrize("block", of(*COMMANDS), ids=named)
def test_commands_can_be_given(block: Block) -> None:
    assert commands(block), "no command: is this another language?"
    own = (ROOT / block.file).parent  # a README is about its folder, a page about the project
    for command in commands(block):
        check(command, own if (own / "Makefile").exists() else ROOT)


@pytest.mark.parametrize(
    "wrong",
    [
        "motord set --torque 3",
        "motord sett --torque-Nm 3",
        "motord plan start calibration",
        "motord plan start calibrate --set torques=2,4",
        "motord analyse coging x.mcap",
        "motord calibration install",
        "make tests",
        "make -C firmware_bridge board",
        "cp config/benches.toml bench.toml",
        "curl http://x",
    ],
)
def test_a_command_that_is_wrong_is_found(wrong: str) -> None:
    with pytest.raises((AssertionError, FileNotFoundError)):
        check(wrong)


@pytest.mark.parametrize("wrong", ["[limit]\ntorque_Nm = 2.0\n", '[limits]\ntorque_Nm = "2"\n'])
def test_toml_that_is_wrong_is_found(wrong: str) -> None:
    with pytest.raises(ValueError, match=r"limit"):
        bench_with(tomllib.loads(wrong))
