"""The table of the interlocks: complete, in the order of the bits, and what is made from it."""

import re
from pathlib import Path

import pytest

from motord.api.descriptions import TRIP_MEANING
from motord.config import Config
from motord.config.text.descriptions import section_of
from motord.control import interlocks, parameters
from motord.control.interlock_table import INTERLOCKS, EvidenceSource, Interlock, trips_from
from motord.schema import Trip
from tests.unit.control.bench import make_config

SOURCE = Path(interlocks.__file__).read_text()


def test_every_bit_has_a_row_at_its_place() -> None:
    assert [row.trip for row in INTERLOCKS] == list(Trip)
    assert [row.bit for row in INTERLOCKS] == list(range(len(Trip)))


@pytest.mark.parametrize("row", INTERLOCKS, ids=lambda row: row.trip.name)
def test_a_row_is_what_the_kernel_and_the_events_have(row: Interlock) -> None:
    config = make_config()
    assert len(re.findall(rf"\b_TRIP\.{row.trip.name}\b", SOURCE)) == 1
    assert getattr(interlocks._TRIP, str(row.trip.name)) == 1 << row.bit
    assert parameters.build(config)[0][0].lasts_ns[row.bit] == round(row.lasts_s(config) * 1e9)
    assert TRIP_MEANING[row.trip] == row.meaning


@pytest.mark.parametrize("row", INTERLOCKS, ids=lambda row: row.trip.name)
def test_limits_are_keys_of_the_bench_file(row: Interlock) -> None:
    for key in filter(None, row.limit.split(", ")):
        section, _, name = key.partition(".")
        table = section_of(Config.model_fields[section])
        assert table is not None
        assert name in table.model_fields


def test_every_source_of_evidence_has_its_bits() -> None:
    assert sum(trips_from(source) for source in EvidenceSource) == sum(
        row.trip for row in INTERLOCKS
    )
    assert Trip(trips_from(EvidenceSource.BRIDGE)) & Trip.TORQUE_STALE
