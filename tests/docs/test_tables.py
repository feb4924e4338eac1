"""Tables in docs that are made from the source."""

import pytest
from tools import record_tables, watch_keys

from motord.cli.bench.watch import keys
from motord.schema import TICK


def test_the_fields_of_a_tick_are_those_of_the_schema(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert record_tables.main(["--check"]) == 0
    monkeypatch.setattr(record_tables, "TICK", type(TICK)("Tick", "", TICK.fields[:-1]))
    assert record_tables.main(["--check"]) == 1
    assert "run tools/record_tables.py" in capsys.readouterr().err


def test_the_keys_of_the_screen_are_those_that_it_takes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert watch_keys.main(["--check"]) == 0
    monkeypatch.setattr(keys, "KEYS", keys.KEYS[1:])
    assert watch_keys.main(["--check"]) == 1
    assert "run tools/watch_keys.py" in capsys.readouterr().err
