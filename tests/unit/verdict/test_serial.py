"""Serial numbers as people write them make names of files that are safe, or are refused."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.verdict.serial import SerialError, certificate_name, check_serial

TIME = "20250101T120000000Z"


def name_of(serial: str) -> str:
    return certificate_name(Path("types/pump 3.toml"), check_serial(serial), TIME)


@pytest.mark.parametrize(
    ("serial", "part"),
    [
        ("4711", "4711"),
        ("A/7", "A%2F7"),
        ("..", ".."),
        (".", "."),
        ("../../etc/passwd", "..%2F..%2Fetc%2Fpasswd"),
        ("a \"b\" 'c'", "a%20%22b%22%20%27c%27"),
        ("50%", "50%25"),
        ("\u00e4", "%C3%A4"),
        ("*?<>|:\\", "%2A%3F%3C%3E%7C%3A%5C"),
        ("-rf", "-rf"),
    ],
)
def test_a_serial_number_in_a_name(serial, part):
    assert name_of(serial) == f"pump%203-{part}-{TIME}.html"


@pytest.mark.parametrize(
    ("serial", "said"),
    [
        ("", "empty"), ("  ", "empty"), (" 1", "space"), ("1 ", "space"), ("a\nb", "printed"),
        ("a\0b", "printed"), ("\x1b[2J", "printed"), ("\u202eab", "printed"),
        ("\udcff", "printed"), ("1" * 121, "too long"), ("\u00e4" * 21, "too long"),
    ],
)  # fmt: skip
def test_what_is_no_serial_number_is_refused(serial, said):
    with pytest.raises(SerialError, match=said):
        check_serial(serial)


@given(st.text(max_size=60), st.text(max_size=60))
def test_any_number_gives_a_name_of_its_own_or_is_refused(one, other):
    names = []
    for serial in (one, other):
        try:
            name = name_of(serial)
        except SerialError:
            return
        assert name == Path(name).name
        assert not name.startswith((".", "-"))
        assert len(f".{name}.{2**22}.tmp") < 255
        assert name.isascii()
        names.append(name)
    assert (names[0] == names[1]) == (one == other)


def test_a_long_name_of_a_type_is_cut():
    name = certificate_name(Path("x" * 300 + ".toml"), "1" * 120, TIME)
    assert len(f".{name}.{2**22}.tmp") < 255
    for odd in ("...toml", "-.toml", ".-x"):
        assert certificate_name(Path(odd), "1", TIME)[0] not in ".-"
