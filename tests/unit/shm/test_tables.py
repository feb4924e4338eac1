"""Tables: swapped whole, never written while in use."""

from pathlib import Path

import numpy as np
import pytest

from motord.control.types import PARAMETERS
from motord.learned import COEFFICIENTS_MAX
from motord.shm.tables import TablesBusyError, TablesReader, TablesWriter

COUNTS = 37


def tables(value: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    parameters = np.zeros(1, PARAMETERS)
    parameters["period_s"] = value
    return (
        parameters,
        np.full((COUNTS, 3), value),
        np.full(COUNTS, value),
        np.full(COEFFICIENTS_MAX, value),
    )


def values(reader: TablesReader) -> set[float]:
    current = reader.current
    period = float(current.parameters["period_s"][0])
    arrays = (np.ravel(table) for table in current[1:])
    return {period, *np.concatenate([*arrays]).tolist()}


@pytest.fixture
def writer(tmp_path: Path) -> TablesWriter:
    return TablesWriter(tmp_path / "tables", COUNTS)


@pytest.fixture
def reader(tmp_path: Path, writer: TablesWriter) -> TablesReader:
    return TablesReader(tmp_path / "tables")


def test_poll_reports_each_new_set_once(writer: TablesWriter, reader: TablesReader) -> None:
    assert reader.counts == COUNTS
    assert not reader.poll()
    for version, value in enumerate((1.0, 2.0, 3.0), start=1):
        assert writer.write(*tables(value)) == version
        assert reader.poll()
        assert values(reader) == {value}
        assert writer.in_use == writer.version == version
        assert not reader.poll()


def test_set_in_use_stays_as_it_is_until_polled(writer: TablesWriter, reader: TablesReader) -> None:
    writer.write(*tables(1.0))
    reader.poll()
    writer.write(*tables(2.0))
    assert values(reader) == {1.0}
    with pytest.raises(TablesBusyError):
        writer.write(*tables(3.0))
    assert values(reader) == {1.0}
    reader.poll()
    assert values(reader) == {2.0}
    writer.write(*tables(3.0))


def test_views_have_the_kernels_shapes(writer: TablesWriter, reader: TablesReader) -> None:
    writer.write(*tables(1.0))
    reader.poll()
    parameters, back_emf, cogging, learned = reader.current
    assert parameters.dtype == PARAMETERS
    assert parameters.shape == (1,)
    assert back_emf.flags.c_contiguous
    assert back_emf.shape == (COUNTS, 3)
    assert cogging.shape == (COUNTS,)
    assert learned.shape == (COEFFICIENTS_MAX,)
    assert all(a.flags.aligned for a in (parameters, back_emf, cogging, learned))


def test_writes_without_a_loop_are_free(writer: TablesWriter, tmp_path: Path) -> None:
    for value in (1.0, 2.0, 3.0):
        writer.write(*tables(value))
    reader = TablesReader(tmp_path / "tables")
    assert reader.poll()
    assert values(reader) == {3.0}


def test_a_dead_loop_can_be_forgotten(writer: TablesWriter, reader: TablesReader) -> None:
    writer.write(*tables(1.0))
    reader.poll()
    writer.write(*tables(2.0))
    writer.forget_loop()
    assert writer.write(*tables(3.0)) == 3


def test_write_between_looking_and_acknowledging_is_taken_up(
    writer: TablesWriter, reader: TablesReader
) -> None:
    writer.write(*tables(1.0))

    class Words:
        """Writes once more as the loop acknowledges."""

        def __getitem__(self, place: int) -> int:
            return words[place]

        def __setitem__(self, place: int, value: int) -> None:
            if value == 1:
                writer.write(*tables(2.0))
            words[place] = value

    words, reader._words = reader._words, Words()
    assert reader.poll()
    assert values(reader) == {2.0}
    assert writer.in_use == 2


def test_tables_of_another_size_are_refused(writer: TablesWriter) -> None:
    parameters, back_emf, cogging, learned = tables(1.0)
    with pytest.raises(ValueError, match=r"expected \(37, 3\), \(37,\) and \(32768,\)"):
        writer.write(parameters, back_emf[1:], cogging, learned)
    with pytest.raises(ValueError, match="expected"):
        writer.write(parameters, back_emf, cogging[1:], learned)
    with pytest.raises(ValueError, match="expected"):
        writer.write(parameters, back_emf, cogging, learned[1:])
    assert writer.version == 0
