"""Are the tests of states, limits and lease good enough to notice a mistake?

`python -m tests.campaigns.mutation [--jobs 2] [MODULE ...]` makes one small mistake after the other
in the modules below (with the operators of Cosmic Ray) and runs their tests on each; at least 90 %
of the mistakes must make a test fail. Kernels run interpreted. No file is changed: each mutant
lives in a process of its own, forked from one that has imported everything else. `--few` makes a
few mistakes that are written down here; every one must be noticed.
"""

import argparse
import importlib.abc
import importlib.machinery
import importlib.util
import os
import resource
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
WANTED = 0.9
CPU_S = 120
"""Processor time, which other programs do not take: a mutant that runs on and on."""

_CONTROL = ("tests/unit/control/test_states.py", "tests/unit/control/test_interlocks.py")
TESTS: dict[str, tuple[str, ...]] = {
    "motord.control.states": _CONTROL,
    "motord.control.interlocks": _CONTROL,
    "motord.control.interlock_table": _CONTROL,
    "motord.control.plausible": (
        "tests/unit/control/test_command_ring.py",
        "tests/unit/control/test_plausible.py",
    ),
    "motord.control.observer": (
        "tests/unit/control/test_observer.py",
        "tests/unit/control/test_interlock_times.py",
    ),
    "motord.sequencing.limits": ("tests/unit/sequencing/test_limits.py",),
    "motord.service.bench.lease": ("tests/unit/service/test_lease.py",),
}
SLOW = "not test_limits_hold_for_any_input and not test_compensation_inverts_the_model"

SPEED_OF_DENSE_SAMPLES_ONLY = """    if dt_s > STEADY_S:
        m.angle_rad = angle_rad
        return
    pole = math.exp("""

FEW = (
    ("motord.control.states", "if causes != 0:", "if causes > 1:"),
    ("motord.control.states", "_REQUEST.RESET and causes == 0", "_REQUEST.RESET"),
    ("motord.control.states", "arming and inverter_ready", "arming"),
    ("motord.control.states", "if stopping and at_zero:", "if stopping:"),
    ("motord.control.interlocks", "largest_A > p.trip", "largest_A > 1.001 * p.trip"),
    ("motord.control.interlocks", "bits & -bits", "bits"),
    ("motord.control.interlocks", "(ratio * ratio - 1.0)", "(ratio * ratio)"),
    (
        "motord.control.interlock_table",
        '"limits.trip_torque_Nm", EvidenceSource.BRIDGE, 0.005',
        '"limits.trip_torque_Nm", EvidenceSource.BRIDGE, 0.006',
    ),
    (
        "motord.control.plausible",
        "later = _sent_after(p, m, f.t_inverter_ns)",
        "later = 0",
    ),
    ("motord.control.plausible", "if settled and back > later + 1:", "if settled:"),
    ("motord.control.plausible", "if settled and back > later + 1:", "if back > later + 1:"),
    ("motord.control.plausible", "if not settled and _passes(", "if _passes("),
    ("motord.control.observer", "    pole = math.exp(", SPEED_OF_DENSE_SAMPLES_ONLY),
    ("motord.config.timing", "POSITION_AGE_MAX_S = 0.03", "POSITION_AGE_MAX_S = 0.1"),
    ("motord.sequencing.limits", "SPEED_MARGIN = 0.8", "SPEED_MARGIN = 0.81"),
    ("motord.service.bench.lease", "held is not None and not force", "held is not None and force"),
)
"""Module, what it says, and what it says with a mistake in it."""

ARITHMETIC = ("Add", "Sub", "Mul", "Div", "FloorDiv", "Mod", "Pow")
BITWISE = ("BitAnd", "BitOr", "BitXor", "LShift", "RShift")
NO_MISTAKES = ("RemoveDecorator", "_Is", "_IsNot", "VariableReplacer", "VariableInserter")
"""Interpreted, a kernel has no compiler to take away; numbers are not distinguished by identity;
the last two must be given the variable.
"""


@dataclass(frozen=True)
class Mutant:
    """A mistake in a module."""

    module: str
    operator: str
    occurrence: int
    line: int
    code: str


def is_used(operator: str) -> bool:
    """Return whether an operator makes mistakes that could be somebody's.

    What mixes arithmetic with bits fails at once, and would only flatter the tests.
    """
    name = operator.removeprefix("core/")
    if name.endswith(NO_MISTAKES):
        return False
    if name.startswith("ReplaceBinaryOperator_"):
        before, after = name.split("_")[1:]
        return (before in ARITHMETIC) == (after in ARITHMETIC)
    return True


def mutants(module: str) -> Iterator[Mutant]:
    """Yield all mutants of a module, the same ones every time."""
    try:
        from cosmic_ray import plugins
        from cosmic_ray.ast import ast_nodes, get_ast
        from cosmic_ray.mutating import mutate_code
    except ImportError as error:
        sys.exit(f"{error}; set it up: pip install cosmic-ray")
    source = _source(module)
    for name in filter(is_used, plugins.operator_names()):
        operator = plugins.get_operator(name)()
        tree = get_ast(source)
        lines = [p[0][0] for n in ast_nodes(tree) for p in operator.mutation_positions(n)]
        for occurrence, line in enumerate(lines):
            code = mutate_code(source, operator, occurrence)
            if code is not None and code != source:
                yield Mutant(module, name.removeprefix("core/"), occurrence, line, code)


def few() -> Iterator[Mutant]:
    """Yield the mutants that are written down."""
    for number, (module, right, wrong) in enumerate(FEW):
        source = _source(module)
        if source.count(right) < 1:
            sys.exit(f"{module} does not say any more: {right}")
        line = source[: source.index(right)].count("\n") + 1
        yield Mutant(module, "few", number, line, source.replace(right, wrong))


def _source(module: str) -> str:
    return (ROOT / "src" / Path(*module.split(".")).with_suffix(".py")).read_text()


class _Mutated(importlib.abc.MetaPathFinder, importlib.abc.SourceLoader):
    """Imports the mutant in the place of its module."""

    def __init__(self, mutant: Mutant) -> None:
        self._mutant = mutant

    def find_spec(self, name, path, target=None):
        if name != self._mutant.module:
            return None
        return importlib.util.spec_from_loader(name, self, origin="mutant")

    def get_filename(self, name: str) -> str:
        return f"<{name}, mutant>"

    def get_data(self, path) -> bytes:
        return self._mutant.code.encode()


class _NoShrinking:
    """A plugin of pytest: an example that fails is enough, the smallest one does not matter."""

    def pytest_sessionstart(self) -> None:
        from hypothesis import Phase, settings

        quick = {"phases": (Phase.explicit, Phase.generate), "database": None}
        settings.register_profile("mutants", settings.get_profile("interpreted"), **quick)
        settings.load_profile("mutants")


def _test(mutant: Mutant) -> int:
    """Run the tests on a mutant, or on none of `code`; return the exit code of pytest."""
    import pytest

    if mutant.code:
        sys.meta_path.insert(0, _Mutated(mutant))
    with Path(os.devnull).open("w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
    options = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--hypothesis-seed=1"]
    options += ["-W", "default", "-k", SLOW]
    return int(pytest.main([*options, *TESTS[mutant.module]], plugins=[_NoShrinking()]))


def killed(every: Sequence[Mutant], jobs: int) -> list[bool]:
    """Return which mutants a test fails on; one that runs on and on counts, too."""
    verdicts, running = [False] * len(every), {}
    for number, mutant in enumerate(every):
        if len(running) >= jobs:
            pid, status = os.wait()
            verdicts[running.pop(pid)] = status != 0
        running[_fork(mutant)] = number
    while running:
        pid, status = os.wait()
        verdicts[running.pop(pid)] = status != 0
    return verdicts


def _fork(mutant: Mutant) -> int:
    """Start the tests on a mutant; return the process."""
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S))
            code = _test(mutant)
        finally:
            os._exit(code)
    return pid


def _prepare() -> None:
    """Import what every test needs but the modules that mutants are of."""
    os.environ["NUMBA_DISABLE_JIT"] = "1"
    os.environ["HYPOTHESIS_STORAGE_DIRECTORY"] = tempfile.mkdtemp(prefix="motord-mutants-")
    os.chdir(ROOT)
    sys.path[:0] = [str(ROOT / "src"), str(ROOT)]
    for name in ("hypothesis.stateful", "numba", "pydantic", "pytest"):
        importlib.import_module(name)


def judge(modules: Sequence[str], jobs: int) -> dict[str, list[tuple[Mutant, bool]]]:
    """Return every mutant of each module, and whether it was killed."""
    verdicts: dict[str, list[tuple[Mutant, bool]]] = {}
    for module in modules:
        if killed([Mutant(module, "", 0, 0, "")], 1)[0]:
            sys.exit(f"{module}: its tests fail without any mistake in it")
        every, begun_s = list(mutants(module)), time.monotonic()
        verdicts[module] = list(zip(every, killed(every, jobs), strict=True))
        sys.stdout.write(_account(module, verdicts[module], time.monotonic() - begun_s))
        sys.stdout.flush()
    return verdicts


def _account(name: str, verdicts: Sequence[tuple[Mutant, bool]], seconds: float) -> str:
    lines = []
    for mutant, was_killed in verdicts:
        if not was_killed:
            text = mutant.code.splitlines()[mutant.line - 1].strip()
            lines.append(f"    {name}:{mutant.line}: {mutant.operator}: {text}\n")
    return "".join(lines) + f"{name}: {_share([dead for _, dead in verdicts])}, {seconds:.0f} s\n"


def _share(dead: Sequence[bool]) -> str:
    return f"{sum(dead)} of {len(dead)} killed, {100 * sum(dead) / len(dead):.1f} %"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--few", action="store_true", help="those that are written down here")
    parser.add_argument("modules", nargs="*", default=list(TESTS))
    options = parser.parse_args()
    _prepare()
    if options.few:
        every = list(few())
        verdict = list(zip(every, killed(every, options.jobs), strict=True))
        sys.stdout.write(_account("few", verdict, time.process_time()))
        return 0 if all(dead for _, dead in verdict) else 1
    verdicts = judge(options.modules, options.jobs)
    every = [dead for each in verdicts.values() for _, dead in each]
    sys.stdout.write(f"{_share(every)}\n")
    return 0 if sum(every) >= WANTED * len(every) else 1


if __name__ == "__main__":
    sys.exit(main())
