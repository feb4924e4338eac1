"""Tables in docs that are made from the source."""

import pytest
from tools import watch_keys

from motord.cli.bench.watch import keys


def test_the_keys_of_the_screen_are_those_that_it_takes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert watch_keys.main(["--check"]) == 0
    monkeypatch.setattr(keys, "KEYS", keys.KEYS[1:])
    assert watch_keys.main(["--check"]) == 1
    assert "run tools/watch_keys.py" in capsys.readouterr().err
