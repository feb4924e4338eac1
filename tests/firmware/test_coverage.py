"""The tests reach what protocol and core are made of."""

from pathlib import Path

import pytest

from tests.firmware import gcov
from tests.firmware.library import FIRMWARE, sources

PERCENT_MIN = 95


@pytest.mark.slow
def test_lines_and_branches_of_protocol_and_core(tmp_path: Path) -> None:
    reached = gcov.measure(tmp_path)
    assert set(map(str, (path.relative_to(FIRMWARE) for path in sources()))) <= set(reached)
    lines, branches = gcov.percent(reached)
    assert lines >= PERCENT_MIN, gcov.table(reached)
    assert branches >= PERCENT_MIN, gcov.table(reached)
