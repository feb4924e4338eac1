"""Tables in docs that are made from the source."""

import pytest
from tools import record_tables

from motord.schema import TICK


def test_the_fields_of_a_tick_are_those_of_the_schema(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert record_tables.main(["--check"]) == 0
    monkeypatch.setattr(record_tables, "TICK", type(TICK)("Tick", "", TICK.fields[:-1]))
    assert record_tables.main(["--check"]) == 1
    assert "run tools/record_tables.py" in capsys.readouterr().err
