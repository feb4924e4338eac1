"""Sparklines, and the characters they are made of."""

import numpy as np
import pytest

from motord.cli.bench.watch.glyphs import ASCII, UNICODE, axis_limits, sparkline, suitable

NAN = float("nan")


def drawn(low, high, rows=1, limits=(0.0, 1.0), braille=True):
    return sparkline(np.array(low), np.array(high), limits, rows, braille=braille)


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [
        ([0.0, 0.0], [0.0, 0.0], "⣀"),
        ([1.0, 1.0], [1.0, 1.0], "⠉"),
        ([0.0, 0.0], [1.0, 0.0], "⣇"),  # a spike of one column
        ([0.0, NAN], [1.0, NAN], "⡇"),
        ([0.5], [0.5], "⠐"),  # an odd column stands at the right
        ([NAN, NAN], [NAN, NAN], " "),
        ([-5.0, 0.0], [9.0, 0.0], "⣇"),  # beyond the edges
    ],
)
def test_a_line_of_braille(low, high, text):
    assert drawn(low, high) == [text]


def test_more_rows_have_more_levels():
    assert drawn([0.0, 1.0], [0.0, 1.0], rows=2) == ["⠈", "⡀"]
    assert drawn([0.0], [1.0], rows=3, braille=False) == ["|"] * 3


def test_a_line_of_ascii_has_three_levels():
    values = [0.1, 0.5, 0.9]
    assert drawn(values, values, braille=False) == [".-'"]
    assert drawn([0.1, 0.5, NAN], [0.5, 0.9, NAN], braille=False) == [":: "]


@pytest.mark.parametrize(
    ("low", "high", "floor", "limits"),
    [
        ([1.0], [3.0], 0.1, (0.0, 3.0)),
        ([-2.0], [3.0], 0.1, (-2.0, 3.0)),
        ([-3.0], [-1.0], 0.1, (-3.0, 0.0)),
        ([0.0], [0.01], 0.3, (0.0, 0.3)),
        ([-0.02], [0.01], 0.3, (-0.3, 0.01)),
        ([NAN], [NAN], 0.0, (0.0, 0.0)),
    ],
)
def test_the_axis_has_all_values_zero_and_a_least_span(low, high, floor, limits):
    assert axis_limits(np.array(low), np.array(high), floor) == limits


@pytest.mark.parametrize(
    ("terminal", "codeset", "glyphs"),
    [
        ("xterm-256color", "UTF-8", UNICODE),
        ("xterm", "ANSI_X3.4-1968", ASCII),
        ("xterm", "ISO-8859-1", ASCII),
        ("linux", "UTF-8", ASCII),
        ("vt100", "UTF-8", ASCII),
    ],
)
def test_characters_that_the_terminal_has(terminal, codeset, glyphs):
    assert suitable({"TERM": terminal}, codeset) is glyphs


def test_a_locale_that_this_computer_lacks_is_as_good_as_none(monkeypatch):
    monkeypatch.setenv("LC_ALL", "xx_XX.nowhere")
    assert suitable({"TERM": "xterm"}) in (ASCII, UNICODE)


def test_ascii_is_ascii():
    assert "".join([ASCII.rule, ASCII.ellipsis, *ASCII.bar, *ASCII.state.values()]).isascii()
