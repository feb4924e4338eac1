"""The bench of the campaign of faults on the wire, which runs for minutes, is one that can be."""

from pathlib import Path

from motord.config import load
from tests.campaigns.fault_wire import RATE_HZ, bench_file


def test_the_bench_of_faults_on_the_wire_is_accepted(tmp_path: Path) -> None:
    config = load(bench_file(tmp_path))
    assert config.loop.rate_Hz == RATE_HZ
    assert config.limits.link_errors_per_s == RATE_HZ + config.sample_rate_Hz
