"""Every number of a bench file has a lower and an upper bound of its own, that its reader sees."""

import math
from collections.abc import Iterator
from typing import Any

import pytest

from motord.config import Config, RecordingConfig, Section
from motord.config.experiments import plans_model
from motord.config.sections import Sections
from tests.unit.config.test_strict import SECTIONS, refuses

OF_ITS_OWN_UNIT = "in the unit that the user chose, of which nothing is known here"
ANY = {
    **{
        ("ChannelConfig", name): OF_ITS_OWN_UNIT
        for name in (
            *("scale", "offset", "valid_min", "valid_max"),
            *("warn_below", "warn_above", "trip_below", "trip_above"),
        )
    },
    ("CanSignalMap", "command_constants"): "any number that the DBC lets a signal have",
    ("CanConfig", "options"): "python-can's, which says what they may be",
    ("CanBusConfig", "options"): "the same",
    ("BridgeCanConfig", "options"): "the same",
}
"""Numbers without bounds of their own, and why; no quantity is beyond 1e12 anyway."""

Bounds = tuple[float | None, float | None]


def numbers(schema: Any) -> Iterator[Bounds]:
    """Yield the bounds of each number that a value of this JSON schema may be or hold."""
    if schema.get("type") in ("number", "integer") and not {"const", "enum"} & schema.keys():
        low = schema.get("minimum", schema.get("exclusiveMinimum"))
        yield low, schema.get("maximum", schema.get("exclusiveMaximum"))
    inner = [*schema.get("anyOf", ()), *schema.get("oneOf", ()), *schema.get("prefixItems", ())]
    inner += [schema.get("items"), schema.get("additionalProperties")]
    for one in inner:
        if isinstance(one, dict):
            yield from numbers(one)


def fields_of_a_bench_file() -> Iterator[tuple[str, str, Bounds]]:
    """Yield table, key and bounds of each number."""
    for top in (Sections, plans_model()):
        schema = top.model_json_schema(by_alias=False)
        for table, content in schema.get("$defs", {}).items():
            for key, field in content.get("properties", {}).items():
                for bounds in numbers(field):
                    yield table, key, bounds


FIELDS = sorted({(table, key) for table, key, _ in fields_of_a_bench_file()})


def test_every_number_has_both_bounds_or_a_reason_why_not() -> None:
    unbounded = {(table, key) for table, key, bounds in fields_of_a_bench_file() if None in bounds}
    assert unbounded == ANY.keys()
    assert len(FIELDS) > 180


@pytest.mark.parametrize(("table", "key"), FIELDS)
def test_no_number_is_infinite_or_none_at_all(table: str, key: str) -> None:
    [kind] = [one for one in SECTIONS if one.__name__ == table]
    for number in (math.nan, math.inf, -math.inf):
        if (table, key) not in ANY or table == "ChannelConfig":
            assert refuses_it(kind, key, number), f"{table}.{key} takes {number}"


def refuses_it(kind: type[Section], key: str, number: float) -> bool:
    """Return whether a key refuses a number, alone, in a list of one to three, or in a table."""
    return all(refuses(kind, key, [number] * n if n else number) for n in range(4))


@pytest.mark.parametrize(("key", "least"), [("file_max_s", 0.5), ("file_max_MB", 0.1)])
def test_there_is_no_file_for_every_look_at_the_ring(key: str, least: float) -> None:
    assert RecordingConfig.model_validate({key: least})
    assert refuses(RecordingConfig, key, 0.99 * least)


def test_an_age_at_which_nothing_is_seen_any_more_is_none() -> None:
    """It says how far the torque sensor may lag: at 10 ms half a period of order 48 at 1 turn/s."""
    content: dict[str, Any] = {"accuracy": {"torque_age_s": 1e12}}
    with pytest.raises(ValueError, match=r"accuracy\.torque_age_s\n.*less than or equal to 0\.01"):
        Config.model_validate(content)
