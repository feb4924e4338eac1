"""Of each measurement one result counts: the newest; what cannot be meant is named."""

from datetime import timedelta

import pytest

from motord.results.error import ResultsError
from motord.results.selection import either, newest, rows_of
from tests.unit.results.made_up import BEGIN, figure, fill, result, row


def versions(*names):
    return [one.version for one in newest([row(version=name) for name in names])]


@pytest.mark.parametrize(
    ("names", "kept"),
    [
        (("1.9", "1.10"), "1.10"),
        (("1.10", "1.9"), "1.10"),
        (("1.2.dev9+gffff", "1.2"), "1.2"),
        (("1.2.dev10+ga", "1.2.dev9+gb"), "1.2.dev10+ga"),
        (("1.2rc1", "1.2"), "1.2"),
        (("1.2.post1", "1.2"), "1.2.post1"),
        (("", "0.0.1"), "0.0.1"),
    ],
)
def test_the_newest_version_counts(names, kept):
    assert versions(*names) == [kept]


def test_other_measurements_stay():
    others = [
        {"run": "b.mcap"}, {"serial": "B"}, {"motor": "B"}, {"experiment": "verify"},
        {"time": BEGIN + timedelta(days=1)},
    ]  # fmt: skip
    rows = [row(version="2.0"), *(row(version="1.0", **other) for other in others)]
    assert newest(rows) == rows


def test_an_added_result_gives_way_to_one_of_the_same_recordings():
    added = row(version="", time=BEGIN + timedelta(days=3))
    assert newest([added, row()]) == [row()]
    other = row(version="", run="other.mcap")
    assert newest([other, row()]) == [other, row()]


def test_several_settings_have_to_be_chosen_from():
    rows = [row(settings='{"method":"joint"}'), row(settings='{"method":"residual"}')]
    with pytest.raises(ResultsError, match=r"joint.*residual.*--where"):
        newest(rows)
    assert len(newest([row(version="0.9", settings="{}"), *rows[:1]])) == 1


@pytest.fixture
def table(tmp_path):
    store = fill(tmp_path / "s", [0.8, 0.9])
    store.add(result(2, experiment="sensitivity", figures=[figure(0.7, "slope_percent", "%")]))
    store.add(result(3, figures=[figure(0.7, "delta_epsilon")], serial="B-7", bench="south"))
    return store.read().table


def test_rows_are_in_order_of_time_whatever_the_names_of_their_files(tmp_path):
    store = fill(tmp_path / "s", 0.8)
    for number in (5, 2, 9):
        store.add(result(number, serial=f"{9 - number}"))
    rows = rows_of(store.read().table, "alpha.a")
    assert [one.run for one in rows] == [f"run-{n:03d}.mcap" for n in (0, 2, 5, 9)]


def test_a_condition_chooses(table):
    assert [one.value for one in rows_of(table, "alpha.a", "value > 0.85")] == [0.9]
    assert [one.field for one in rows_of(table, "delta_epsilon", "false OR true")] == [
        "delta_epsilon"
    ]
    assert [one.field for one in rows_of(table, None, "bench = 'south' -- only")] == [
        "delta_epsilon"
    ]


@pytest.mark.parametrize(
    ("field", "where", "why"),
    [
        ("alpha", "", r"no field 'alpha'; near: alpha\.a"),
        ("delta_epsilom", "", "near: delta_epsilon"),
        ("zzz", "", "near: alpha.a, delta_epsilon, slope_percent"),
        ("alpha.a", "serial = 'none'", "no results where serial = 'none'"),
        ("alpha.a", "no such", "SQL: "),
        ("alpha.a", "true; DROP VIEW results", "SQL: "),
        ("alpha.a", "value > (SELECT count(*) FROM read_text('/etc/hostname'))", "SQL: "),
    ],
)
def test_what_is_not_there_is_named_with_what_is_near(table, field, where, why):
    with pytest.raises(ResultsError, match=why):
        rows_of(table, field, where)


def test_a_field_of_two_experiments_is_chosen_from(tmp_path):
    store = fill(tmp_path / "s", 0.8)
    store.add(result(1, experiment="sensitivity"))
    with pytest.raises(ResultsError, match="calibrate, sensitivity: choose one with --where"):
        rows_of(store.read().table, "alpha.a")


def test_an_empty_store_is_named(tmp_path):
    with pytest.raises(ResultsError, match="the store is empty"):
        rows_of(fill(tmp_path / "s", []).read().table, "alpha.a")


@pytest.mark.parametrize(
    ("a", "b", "column"),
    [("A", "B", "serial"), ("a.mcap", "b.mcap", "run"), ("1", "2", "version")],
)
def test_what_is_compared_is_known_by_its_name(a, b, column):
    rows = [
        row(serial="A", run="a.mcap, x.mcap", version="1"),
        row(serial="B", run="b.mcap", version="2"),
    ]
    assert either(rows, a, b) == (column, rows[:1], rows[1:])


@pytest.mark.parametrize(
    ("a", "b", "why"),
    [
        ("A", "AC", "no serial number, recording or version 'AC'; near: A"),
        ("a.mca", "b.mcap", "'a.mca'; near: a.mcap"),
        ("A", "b.mcap", "A and b.mcap are not both"),
        ("x.mcap", "b.mcap", "x.mcap is a recording of A, B: choose with --where"),
    ],
)
def test_what_cannot_be_compared_is_named(a, b, why):
    rows = [
        row(serial="A", run="a.mcap, x.mcap", version="1"),
        row(serial="B", run="b.mcap, x.mcap", version="1"),
    ]
    with pytest.raises(ResultsError, match=why):
        either(rows, a, b)


def test_results_in_several_units_are_not_charted_as_one(tmp_path):
    store = fill(tmp_path / "s", [0.8])
    store.add(result(1, figures=[figure(800.0, "alpha.a", "mNm")]))
    table = store.read().table
    with pytest.raises(ResultsError, match="in no unit and in mNm: choose with --where"):
        rows_of(table, "alpha.a")
    assert [one.value for one in rows_of(table, "alpha.a", "unit = 'mNm'")] == [800.0]
