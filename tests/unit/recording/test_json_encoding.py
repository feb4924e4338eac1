"""JSON and metadata strings."""

import json
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.recording.json_encoding import (
    JSON_KEYS,
    from_strings,
    misfit,
    plain,
    to_json,
    to_strings,
)

keys = st.text("abcdefgh_", min_size=1)
finite = st.floats(allow_nan=False, allow_infinity=False)
scalars = st.none() | st.booleans() | st.integers() | finite | st.text()
values = st.recursive(scalars, lambda v: st.lists(v) | st.dictionaries(st.text(), v), max_leaves=9)


@given(st.dictionaries(keys, values, max_size=5))
@settings(max_examples=40)
def test_metadata_comes_back_as_it_was(metadata):
    strings = to_strings(metadata)
    assert all(isinstance(text, str) for text in strings.values())
    assert from_strings(strings) == metadata


def test_text_that_looks_like_json_stays_text():
    assert from_strings(to_strings({"notes": "[1]", "n": 1})) == {"notes": "[1]", "n": 1}
    assert JSON_KEYS not in to_strings({"notes": "5"})
    assert from_strings({}) == {}
    with pytest.raises(ValueError):
        from_strings({"n": "{", JSON_KEYS: "n"})


def test_numpy_paths_and_infinities_become_plain():
    value = {
        "a": np.float32(0.5), "b": np.arange(2), "c": Path("x"), "d": [np.nan, -np.inf],
        "e": (np.int64(3), np.bool_(True)), 5: {None}, "f": np.array(["t"]),
        "g": [datetime(2026, 3, 2, 8), datetime(2026, 3, 2, 8, tzinfo=UTC)],
    }  # fmt: skip
    assert plain(value) == {
        "a": 0.5, "b": [0, 1], "c": "x", "d": [None, None], "e": [3, True], "5": [None],
        "f": ["t"], "g": ["2026-03-02T08:00:00Z", "2026-03-02T08:00:00+00:00"],
    }  # fmt: skip
    assert json.loads(to_json(value)) == plain(value)
    assert to_json({"a": "ü"}) == '{"a":"ü"}'


@pytest.mark.parametrize("kind", ["integer", "number"])
@pytest.mark.parametrize(
    "value", [pytest.param(10**400, id="long"), float("inf"), float("nan"), True, "1"]
)
def test_what_no_double_holds_is_no_number(kind, value):
    assert f"type {kind} is needed" in misfit({"x": value}, {"properties": {"x": {"type": kind}}})
    assert not misfit({"x": -2}, {"properties": {"x": {"type": kind}}})
