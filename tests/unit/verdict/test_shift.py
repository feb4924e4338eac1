"""Lines of a bar-code reader: which are tested, and what the shift counts."""

import pytest

from motord.verdict.serial import NAME_MAX, SerialError, certificate_name
from motord.verdict.shift import REPEAT_S, Shift, earlier_verdict


@pytest.mark.parametrize("line", ["4711", "A-47/11 b", "Größe 3", "1" * NAME_MAX])
def test_a_serial_number_is_taken_as_it_is(line):
    assert Shift().serial_of(line.encode(), 0.0) == line


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (b"", "is empty"),
        (b"   ", "is empty"),
        (b" 4711", "begins or ends with a space"),
        (b"\x1b[31m4711", "cannot be printed"),
        (b"\x02" + b"4711\x03", "cannot be printed"),
        (b"47\x0011", "cannot be printed"),
        (b"\xff\xfe", "not text in UTF-8"),
        (b"1" * (NAME_MAX + 1), "too long"),
        (b"/" * (NAME_MAX // 3 + 1), "too long"),
        (b"\x1b" * 5000, "too long"),
    ],
)
def test_a_line_that_is_none_is_refused_in_one_short_line(line, said):
    with pytest.raises(SerialError, match=said) as caught:
        Shift().serial_of(line, 0.0)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 600


def test_a_reader_that_types_twice_tests_once():
    shift = Shift()
    shift.serial_of(b"1", 10.0)
    shift.add("1", "pass")
    shift.ended_s = 30.0
    with pytest.raises(SerialError, match="typed twice"):
        shift.serial_of(b"1", 30.0 + 0.99 * REPEAT_S)
    assert shift.serial_of(b"2", 30.0) == "2"
    assert shift.serial_of(b"1", 30.0 + REPEAT_S) == "1"


def test_the_shift_counts_and_remembers():
    shift = Shift()
    for serial, decision in (("1", "fail"), ("2", "error"), ("1", "pass")):
        shift.add(serial, decision)
    assert (shift.earlier("1"), shift.earlier("2"), shift.earlier("3")) == ("pass", "error", "")
    assert shift.to_text() == "3 tested: 1 pass, 1 fail, 0 undecidable, 1 error"


def test_the_newest_certificate_of_exactly_this_serial_number_counts(tmp_path):
    kind = tmp_path / "pump.toml"

    def certificate(serial, stamp, title):
        text = f"<title>m, serial {serial}: {title}</title>"
        (tmp_path / certificate_name(kind, serial, stamp)).write_text(text)

    assert earlier_verdict(tmp_path / "none", kind, "47") == ""
    certificate("47-11", "20260101T000000000Z", "pass")
    assert earlier_verdict(tmp_path, kind, "47") == ""
    certificate("47", "20260102T083000000Z", "fail")
    certificate("47", "20260101T083000000Z", "pass")
    certificate("47", "20260103T083000000Z", "what is no certificate")
    assert earlier_verdict(tmp_path, kind, "47") == "fail, 2026-01-02 08:30 UTC"
    assert earlier_verdict(tmp_path, kind, "47-11") == "pass, 2026-01-01 00:00 UTC"
