"""Settings of hypothesis (no deadlines: kernels compile on first use) and of skipped tests."""

import os

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile(
    "motord", deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True
)
settings.register_profile("interpreted", parent=settings.get_profile("motord"), max_examples=8)
settings.load_profile("interpreted" if os.environ.get("NUMBA_DISABLE_JIT") == "1" else "motord")


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """With MOTORD_NO_SKIPS=1, as in continuous integration, a skipped test is a failure."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if os.environ.get("MOTORD_NO_SKIPS") != "1" or reporter is None:
        return
    skipped = reporter.stats.get("skipped", [])
    if skipped and exitstatus == 0:
        reporter.write_line(f"{len(skipped)} skipped, and MOTORD_NO_SKIPS is set: failing")
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
