"""Files, JSON and TOML of others: an OSError or a ValueError, whatever they are."""

import os
import re
import tomllib

import pytest
from pydantic import TypeAdapter, ValidationError

from motord import untrusted
from motord.config import ConfigError, load
from motord.config.base import BitRate, Mask
from motord.untrusted import parse_json, parse_toml, read_bytes, read_text

DEEP = 100_000


def test_a_device_that_never_ends_is_an_error(monkeypatch):
    monkeypatch.setattr(untrusted, "SIZE_MAX", 1 << 20)
    with pytest.raises(OSError, match="larger than 1 MB"):
        read_bytes(untrusted.Path("/dev/zero"))


def test_a_zero_byte_in_a_path_is_an_error(tmp_path):
    with pytest.raises(OSError, match="no path of a file"):
        read_text(tmp_path / "a\0b")


def test_lines_end_alike_and_a_mark_of_byte_order_is_no_text(tmp_path):
    path = tmp_path / "windows.toml"
    path.write_bytes(b'\xef\xbb\xbfa = 1\r\nb = "\xc3\xbc"\r\n')
    assert read_text(path) == 'a = 1\nb = "ü"\n'
    path.write_bytes(b"a\xff")
    with pytest.raises(UnicodeDecodeError):
        read_text(path)


def test_what_is_handed_over_by_a_pipe_is_read():
    reading, writing = os.pipe()
    os.write(writing, b"a = 1\n")
    os.close(writing)
    assert read_text(untrusted.Path(f"/dev/fd/{reading}")) == "a = 1\n"
    os.close(reading)


def test_a_key_that_looks_like_a_place_is_none():
    with pytest.raises(ValueError, match=r"\(at line 2, column 14\): \['at line 99'\]$"):
        parse_toml("['at line 99']\n['at line 99']\n")


@pytest.mark.parametrize("parse", [parse_json, parse_toml])
@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[" * DEEP + "]" * DEEP, "nested too deeply"),
        ("1" * 5000, "thousands of digits"),
        ("{", ".+"),
        ("nonsense", ".+"),
    ],
    ids=["deep", "digits", "cut off", "nonsense"],
)
def test_what_cannot_be_understood_is_a_value_error(parse, text, why):
    with pytest.raises(ValueError, match=why):
        parse(f"a = {text}" if parse is parse_toml else text)


@pytest.mark.parametrize(
    "text",
    ["a = " + "[" * DEEP + "]" * DEEP, f"[loop]\nrate_Hz = {'1' * 5000}", "[loop]\ncpu = 8192"],
    ids=["deep", "digits", "cpu"],
)
def test_a_bench_file_is_refused_in_one_line(tmp_path, text):
    path = tmp_path / "bench.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"bench\.toml"):
        load(path)


@pytest.mark.parametrize(
    ("field", "value", "places"),
    [
        ("rig", '"\\u0000"', 1),
        ("order", "65536", 1),
        ("order", "1" * 30, 1),
        ("amplitude_V_s_per_rad", "0.0", 4),
        ("highpass_time_constant_s", "5e-324", 1),
    ],
)
def test_what_a_bench_file_cannot_mean_is_refused(tmp_path, field, value, places):
    from motord.config import packaged
    from motord.virtual import VirtualBench

    text = packaged("sim.toml").read_text().replace('rig = "', 'rig = "package:')
    given = rf"\b{field} = [^,}}\n]+"
    text, found = re.subn(given, lambda _: f"{field} = {value}", text, count=places)
    assert found == places
    path = tmp_path / "bench.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        VirtualBench(load(path))
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize(("kind", "most"), [(BitRate, 100_000_000), (Mask, 2**64 - 1)])
def test_whole_numbers_end_where_devices_do(kind, most):
    assert TypeAdapter(kind).validate_python(most) == most
    for beyond in (most + 1, 10**30):
        with pytest.raises(ValidationError):
            TypeAdapter(kind).validate_python(beyond)


def test_a_recording_of_a_bench_file_from_a_windows_editor_says_what_it_is_of(tmp_path):
    from motord.config import load_started, packaged
    from motord.recording.metadata import describe

    path = tmp_path / "bench.toml"
    text = packaged("sim.toml").read_text().replace('rig = "', 'rig = "package:')
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    metadata = describe(*load_started(path, kept=path))
    assert tomllib.loads(metadata["config"])["bench"]["name"] == "sim"
