"""How text becomes markup: what is escaped, what stays as it is, what stays together."""

import pytest

from motord.findings import Finding
from motord.report.html import Markup, Page, Verbatim, escape


def test_only_markup_is_not_escaped():
    page = Page("x", style="p{color:red}")
    page.table(("a", "b"), [("<i>1</i>", Markup("<b>2</b>"))])
    html = page.html()
    assert "<td>&lt;i&gt;1&lt;/i&gt;</td><td><b>2</b></td>" in html
    assert "p{color:red}</style>" in html


def test_no_line_ends_within_an_interval():
    assert escape("0.80 +- 0.02") == "0.80\u00a0\u00b1\u00a00.02"
    assert escape("3.142 +- inf") == "3.142\u00a0\u00b1\u00a0inf"
    assert escape("(+-1.2 %)") == "(\u00b11.2 %)"


@pytest.mark.parametrize(
    ("text", "markup"),
    [
        ("-0.5 (-3 %) [-inf]", "\u22120.5 (\u22123 %) [\u2212inf]"),
        ("3-5 of 2026-01-02, a-1, -x, 1 - 2, --set -o, zero_rad = -0.1", None),
        ("25 degC, 3 us, 90 deg later", "25\u00a0\u00b0C, 3\u00a0\u00b5s, 90\u00b0 later"),
        ("2 uses, us, degC, 3 degrees", None),
        ("-1.5 +- 0.2 us", "\u22121.5\u00a0\u00b1\u00a00.2\u00a0\u00b5s"),
    ],
)
def test_signs_and_units_of_numbers_are_those_of_figures(text, markup):
    assert escape(text) == (markup or text)
    assert escape(Verbatim(text)) == text


def test_names_paths_and_notes_stay_as_they_were_written():
    assert escape("runs/a+-b.mcap: no +- in it") == "runs/a+-b.mcap: no +- in it"
    page = Page("pump 3 +- 1", "pump 3 +- 1 on bench +-1")
    page.facts([("recordings", "3 +- 1/+-2.mcap")])
    page.paragraph(Verbatim("turned by 3 +- 1 deg"))
    assert "\u00b1" not in page.html()


@pytest.mark.parametrize(
    ("value", "unit", "size"),
    [
        (1, "directions", "1 direction (limit 2)"), (1.0, "quantities", "1 quantity (limit 2)"),
        (1, "operating points", "1 operating point (limit 2)"),
        (1, "us", "1\u00a0\u00b5s (limit 2)"),
        (3, "directions", "3 directions (limit 2)"), (1, "turns/s", "1 turns/s (limit 2)"),
        (1, "ratio of speeds", "1 ratio of speeds (limit 2)"),
    ],
)  # fmt: skip
def test_one_is_not_spoken_of_as_several(value, unit, size):
    page = Page("A motor")
    page.findings([Finding("few", value, 2, unit, "note", "few", "more")])
    assert f"note \u00b7 {size}<" in page.html()


def test_a_finding_spells_a_channel_as_it_is_spelled():
    page = Page("A motor")
    page.findings([Finding("not-steady", 2.1, 2.0, "%", "note", "magnet_C rises", "wait")])
    assert "<p>magnet_C rises.</p><p><em>Wait.</em>" in page.html()
