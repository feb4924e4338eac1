"""Settings of hypothesis, seeds, what forgiven trips came to, and skipped tests.

`make test` is to end the same way every time: hypothesis draws the same examples in every run,
whatever ran before and in which process. `make soak` sets MOTORD_HYPOTHESIS=soak and hands over a
seed of its own, with which a run can be repeated.
"""

import os

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers

settings.register_profile(
    "motord",
    deadline=None,  # kernels compile on first use, and computers stall
    suppress_health_check=[HealthCheck.too_slow],
    print_blob=True,
    derandomize=True,
    database=None,
)
settings.register_profile("interpreted", parent=settings.get_profile("motord"), max_examples=8)
settings.register_profile("soak", parent=settings.get_profile("motord"), derandomize=False)
SOAK = os.environ.get("MOTORD_HYPOTHESIS") == "soak"
INTERPRETED = os.environ.get("NUMBA_DISABLE_JIT") == "1"
settings.load_profile("soak" if SOAK else "interpreted" if INTERPRETED else "motord")

if not SOAK:
    # hypothesis also draws numbers that stand in the modules that happen to be loaded
    nothing = providers.Constants()
    assert callable(providers._get_local_constants)
    providers._get_local_constants = lambda: nothing


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """With MOTORD_NO_SKIPS=1, as in continuous integration, a skipped test is a failure."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if os.environ.get("MOTORD_NO_SKIPS") != "1" or reporter is None:
        return
    skipped = reporter.stats.get("skipped", [])
    if skipped and exitstatus == 0:
        reporter.write_line(f"{len(skipped)} skipped, and MOTORD_NO_SKIPS is set: failing")
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
