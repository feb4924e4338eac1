"""A trace from a CSV file: what can be read is read right, the rest is refused with its line."""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.experiments.profile import trace as traces
from motord.experiments.profile.trace import Trace, read
from motord.sequencing import PlanError

HEADER = "time_s,torque_Nm,speed_Hz\n"

NUMBERS = st.floats(-1e9, 1e9)
TIMES = st.lists(st.integers(1, 10**7), max_size=12, unique=True).map(
    lambda inner: [0, *sorted(inner), 10**7 + 1]
)
"""Whole ms."""


@pytest.fixture(scope="module")
def parse(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str | bytes], Trace]:
    path = tmp_path_factory.mktemp("traces") / "cycle.csv"

    def parse(content: str | bytes) -> Trace:
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return read(str(path))

    return parse


def refused(parse: Callable[[str | bytes], Trace], content: str | bytes) -> str:
    with pytest.raises(PlanError) as error:
        parse(content)
    return str(error.value).split("cycle.csv", 1)[1]


@given(
    times=TIMES,
    data=st.data(),
    end=st.sampled_from(["\n", "\r\n", "\r"]),
    mark=st.sampled_from([",", ";", "\t"]),
    bom=st.booleans(),
    last=st.booleans(),
    blank=st.booleans(),
)
def test_numbers_come_as_they_were_written(
    parse: Callable[[str | bytes], Trace],
    times: list[int], data: st.DataObject, end: str, mark: str, bom: bool, last: bool, blank: bool,
) -> None:  # fmt: skip
    rows = [(t / 1000, data.draw(NUMBERS), data.draw(NUMBERS)) for t in times]
    lines = [mark.join(["speed_Hz", "note", "time_s", "torque_Nm"])]
    lines += [mark.join([repr(n), "x", repr(t), repr(T)]) for t, T, n in rows]
    lines[1:1] = ["", mark * 3, "# a remark"] * blank
    found = parse(("\ufeff" if bom else "") + end.join(lines) + (end if last else ""))
    t_s, torque_Nm, speed_Hz = np.array(rows).T
    assert np.array_equal(found.time_s, t_s - t_s[0])
    assert np.array_equal(found.torque_Nm, torque_Nm)
    assert np.array_equal(found.speed_Hz, speed_Hz)
    assert found.line.tolist() == [n + 2 + 3 * blank for n in range(len(rows))]


@given(st.one_of(st.binary(max_size=200), st.text(max_size=200).map(str.encode)))
def test_anything_is_read_or_refused_in_one_line(
    parse: Callable[[str | bytes], Trace], content: bytes
) -> None:
    for text in (content, HEADER.encode() + b"0,0,0\n" + content):
        said, found = "", None
        try:
            found = parse(text)
        except PlanError as error:
            said = str(error)
        assert "\n" not in said
        assert len(said) < 400
        if found is not None:
            assert np.isfinite([found.time_s, found.torque_Nm, found.speed_Hz]).all()
            assert (np.diff(found.time_s) > 0).all()


def test_units_are_converted_and_a_comma_may_be_decimal(
    parse: Callable[[str | bytes], Trace],
) -> None:
    found = parse("time_ms;torque_mNm;speed_rpm\n0;0;0\n1500;2500,5;90\n")
    assert (found.time_s[1], found.torque_Nm[1], found.speed_Hz[1]) == (1.5, 2.5005, 1.5)
    for name in ("speed_rad_s", "speed_rad_per_s"):
        found = parse(f'"time_min","torque_Nm","{name}"\n0,0,0\n1,1,6.283185307179586\n')
        assert (found.time_s[1], found.speed_Hz[1]) == (60.0, pytest.approx(1.0))


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("", ": is empty; its first line names time_s, torque_Nm and speed_Hz"),
        (" \n,,\n# only a remark\n", ": is empty"),
        (HEADER, ": has 0 rows; it takes two"),
        (HEADER + "0,0,0\n", ": has 1 rows"),
        ("0,0,0\n1,1,1\n", ":1: no column of the time"),
        ("time,torque_Nm,speed_Hz\n0,0,0\n1,0,0", ":1: 'time' has no known unit"),
        ("time_s,torque_Nm,speed_kmh\n0,0,0\n1,0,0", ":1: 'speed_kmh' has no known unit"),
        ("# x\n\ntime_s,torque_Nm\n0,0\n1,0", ":3: no column of the speed"),
        ("time_s,torque_Nm,speed_Hz,speed_rpm\n0,0,0,0", ":1: speed is ambiguous"),
        ("time_s,time_s,torque_Nm,speed_Hz\n0,0,0,0", ":1: time is ambiguous: time_s, time_s"),
        (HEADER + "0,0,0\n1,nan,0\n", ":3: torque_Nm is 'nan', no finite number"),
        (HEADER + "0,0,0\n1,1e308,0\n", ":3: torque_Nm is '1e308', beyond 1e12"),
        (HEADER + "0,0,0\n1,0,inf\n", ":3: speed_Hz is 'inf'"),
        (HEADER + "0,0,0\n1,0,1e300\n", ":3: speed_Hz is '1e300'"),
        (HEADER + "0,0,0\n1,,0\n", ":3: torque_Nm is ''"),
        (HEADER + "0,0,0\n1_0,0,0\n", ":3: time_s is '1_0'"),
        (HEADER + "0,0,0\n1,2\n", ":3: has 2 columns, speed_Hz is in column 3"),
        (HEADER + "0,0,0\n1,0,0\n1,0,0\n", ":4: time 1 s does not come after 1 s in line 3"),
        (HEADER + "5,0,0\n\n4,0,0\n", ":4: time 4 s does not come after 5 s in line 2"),
        (HEADER + "0,0,0\n0.999,0,0\n", ":3: lasts 0.999 s; from 1 to 86400 s can be played"),
        (HEADER + "0,0,0\n1e12,0,0\n", ":3: lasts 1e+12 s; from 1 to 86400 s"),
        (HEADER.encode() + b"0,0,0\n1,\xff,0\n", ": not a text file in UTF-8 (byte 34)"),
        (HEADER.encode("utf-16"), ": not a text file in UTF-8 (byte 0)"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_its_line(
    parse: Callable[[str | bytes], Trace], content: str | bytes, expected: str
) -> None:
    assert refused(parse, content).startswith(expected)


def test_a_message_shows_little_of_a_long_cell(parse: Callable[[str | bytes], Trace]) -> None:
    assert len(refused(parse, HEADER + "0,0,0\n1," + "x" * 10_000 + ",0\n")) < 100
    assert len(refused(parse, "time_" + "x" * 10_000 + "\n")) < 200


def test_a_million_rows_are_read_and_no_more(
    parse: Callable[[str | bytes], Trace], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(traces, "MAX_ROWS", 100_000)
    rows = [f"{n / 2},1,0.5" for n in range(100_000)]
    assert parse(HEADER + "\n".join(rows)).time_s.size == 100_000
    assert ":100002: more than 100000 rows; take fewer" in refused(
        parse, HEADER + "\n".join([*rows, "100000,1,1"])
    )
    monkeypatch.setattr(traces, "MAX_BYTES", 1 << 20)
    assert ": larger than 1 MiB" in refused(parse, HEADER + "\n".join(rows * 2))


def test_only_a_csv_file_is_read(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)
    (tmp_path / "folder.csv").mkdir()
    secret = tmp_path / "secret"
    secret.write_text("password")
    for name, expected in (
        (str(secret), "the name of a CSV file ends in .csv"),
        ("", "the name of a CSV file ends in .csv"),
        (str(pipe), "is no file"),
        (str(tmp_path / "folder.csv"), "is no file"),
        (str(tmp_path / "none.csv"), "cannot read it: No such file or directory; it is read on"),
        ("a\nb.csv", "the name of a CSV file ends in .csv"),
        ("a\0b.csv", "the name of a CSV file ends in .csv"),
        ("x" * 4000 + ".csv", "cannot read it: File name too long"),
        ("package:none.csv", "cannot read it"),
        ("~nobody here/a.csv", "cannot read it"),
    ):
        with pytest.raises(PlanError, match=r"^profile: ") as error:
            read(name)
        assert expected in str(error.value)
        assert "password" not in str(error.value)


def test_another_content_than_the_one_that_is_meant_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "cycle.csv"
    path.write_text(HEADER + "0,0,0\n1,0,0\n")
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    assert read(str(path), digest).sha256 == digest
    path.write_text(HEADER + "0,0,0\n2,0,0\n")
    with pytest.raises(PlanError, match="its content has changed"):
        read(str(path), digest)
