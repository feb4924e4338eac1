"""Settings of hypothesis, order of files, what forgiven trips came to, and skipped tests.

`make test` is to end the same way every time: hypothesis draws the same examples in every run,
whatever ran before and in which process. `make soak` sets MOTORD_HYPOTHESIS=soak and hands over a
seed of its own, with which a run can be repeated.
"""

import gc
import os
import socket
from collections import Counter
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers

import motord.python_can  # noqa: F401  # so that no `import can` of a test loads asammdf and pandas
from tests.support import again, collecting, schedule, stalls
from tests.support.ports import default_ports_taken
from tests.support.properties import FEW, INTERPRETED, SOME

_PORTS = pytest.StashKey[list[socket.socket]]()

settings.register_profile(
    "motord",
    deadline=None,  # kernels compile on first use, and computers stall
    suppress_health_check=[HealthCheck.too_slow],
    print_blob=True,
    derandomize=True,
    database=None,
)
settings.register_profile("interpreted", parent=settings.get_profile("motord"), max_examples=FEW)
settings.register_profile("soak", parent=settings.get_profile("motord"), derandomize=False)
settings.register_profile("quick", parent=settings.get_profile("motord"), max_examples=SOME)
PROFILE = os.environ.get("MOTORD_HYPOTHESIS", "interpreted" if INTERPRETED else "motord")
SOAK = PROFILE == "soak"
NO_SKIPS = os.environ.get("MOTORD_NO_SKIPS") == "1"
"""Set in continuous integration."""
settings.load_profile(PROFILE)

if not SOAK:
    # hypothesis also draws numbers that stand in the modules that happen to be loaded; no setting
    # of it turns that off (6.170), so this reaches into it
    nothing = providers.Constants()
    assert callable(providers._get_local_constants)
    providers._get_local_constants = lambda: nothing


def pytest_configure(config: pytest.Config) -> None:
    """In continuous integration the first process keeps default ports from all tests."""
    if NO_SKIPS and not hasattr(config, "workerinput"):
        config.stash[_PORTS] = default_ports_taken()


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Generator[None, object, object]:
    """Spare the garbage collector what stays: modules and tests, half a second each time."""
    gc.disable()
    try:
        if hasattr(session.config, "workerinput"):
            collecting.import_part(session.config)
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """In processes of pytest-xdist files run in an order of their own."""
    if hasattr(config, "workerinput"):
        schedule.longest_first(items)


def pytest_collection_finish(session: pytest.Session) -> None:
    """Processes of pytest-xdist that run no system tests give way to those that do.

    Not before: none runs a test until all have collected them.
    """
    if hasattr(session.config, "workerinput"):
        schedule.give_way(session.config.workerinput["workerid"])


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> schedule.Lanes | None:
    """Hand out whole files, those of system tests in lanes."""
    return schedule.Lanes(config, log) if config.getoption("dist") == "loadfile" else None


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Run a system test again that failed because a stall has tripped its simulated bench."""
    return again.run(item, nextitem) if item.get_closest_marker("system") else None


_seconds: Counter[str] = Counter()
_forgiven: list[str] = stalls.FORGIVEN


_terminal: list[pytest.TerminalReporter] = []


def pytest_sessionstart(session: pytest.Session) -> None:
    """Keep where failures are printed to, which only the process that prints has."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if not hasattr(session.config, "workerinput"):
        _terminal.append(reporter)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Add up the time of each file of tests, and print a failure at once, not after minutes."""
    _seconds[schedule.file_of(report.nodeid)] += report.duration
    if report.failed and _terminal:
        _terminal[0].write_line(f"\n{report.nodeid} ({report.when}):\n{report.longreprtext}")


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any, error: object) -> None:
    """Take over from a process of pytest-xdist what it was forgiven."""
    _forgiven.extend(getattr(node, "workeroutput", {}).get("forgiven", []))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say how long each folder took, and which trips were forgiven."""
    if len(_seconds) > 1:
        folders: Counter[str] = Counter()
        for file, seconds in _seconds.items():
            folders[str(Path(file).parent)] += seconds
        times = ", ".join(f"{name} {seconds:.0f}" for name, seconds in folders.most_common())
        terminalreporter.write_line(f"seconds by folder: {times}")
    terminalreporter.write_line(f"{len(_forgiven)} trips forgiven to a computer that stalled")
    for line in _forgiven:
        terminalreporter.write_line(f"  {line}")


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """With MOTORD_NO_SKIPS=1, as in continuous integration, a skipped test is a failure."""
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["forgiven"] = stalls.FORGIVEN
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if os.environ.get("MOTORD_TEST_DURATIONS") == "1" and reporter is not None:
        schedule.write_durations(_seconds)
    if not NO_SKIPS or reporter is None:
        return
    skipped = reporter.stats.get("skipped", [])
    if skipped and exitstatus == 0:
        reporter.write_line(f"{len(skipped)} skipped, and MOTORD_NO_SKIPS is set: failing")
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
