import re
from functools import partial
from html.parser import HTMLParser
from io import BytesIO
from itertools import pairwise, product
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import matplotlib as mpl
import pytest
from matplotlib.backend_bases import Event
from matplotlib.figure import Figure

import motord
from motord.findings import Finding, Severity
from motord.report.html import Page, inline, typeset
from motord.report.style import PALETTE, drawing, figure
from tests.unit.report.made_up import curve, estimate, page

LEVELS = tuple(f"h{level}" for level in range(1, 7))


class Structure(HTMLParser):
    """Collects ids and what elements refer to; checks that tags close in order."""

    VOID = ("meta", "br")

    def __init__(self) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.references: list[str] = []
        self.open: list[str] = []
        self.headings: list[str] = []
        self.levels: list[int] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in self.VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value or "")
            elif name in ("src", "href", "xlink:href"):
                self.references.append(value or "")
            elif value and "url(" in value:
                self.references += re.findall(r"url\(([^)]*)\)", value)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        self.open.pop()

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in LEVELS:
            self.levels.append(LEVELS.index(self.open[-1]) + 1)
        if self.open and self.open[-1] == "h2":
            self.headings.append(data)


def structure(html: str) -> Structure:
    parser = Structure()
    parser.feed(html)
    assert parser.open == []
    return parser


@pytest.fixture(scope="module")
def html() -> str:
    """The page of all parts; to draw it takes a second."""
    return page().html()


def test_page_needs_nothing_from_elsewhere(html: str) -> None:
    found = structure(html)
    assert len(found.ids) == len(set(found.ids))
    for reference in found.references:
        assert reference.startswith("data:") or reference.removeprefix("#") in found.ids
    assert "<script" not in html
    assert "@import" not in html
    assert found.headings == [
        "Torque ripple over the mesh",
        "Torque at 3 Nm, 0.5 turns/s",
        "Phase gains and offsets",
        "Cogging torque",
    ]
    assert "Calibration &lt;of&gt; a motor &amp; more" in html
    assert "<of>" not in html


def test_key_figures_and_tables(html: str) -> None:
    assert "<b>6.50 % (interval not known)</b>" in html
    assert "<b>0.15 % (interval not known)</b>" in html
    assert "0.8008\u00a0\u00b1\u00a00.0020" in html
    assert "<td>0.8000</td>" in html  # the truth has no error
    assert "100.0\u00a0\u00b1\u00a02.0" in html


def test_the_label_of_a_picture_has_the_signs_of_its_caption() -> None:
    with figure(1.0) as picture:
        picture.subplots()
    made = Page("")
    made.picture(picture, "from -2 to +-3 Nm & 4 us")
    text = "from \u22122 to \u00b13 Nm &amp; 4\u00a0\u00b5s"
    assert f'aria-label="{text}"' in made.html()
    assert f"<figcaption>{text}</figcaption>" in made.html()


@pytest.mark.parametrize(
    ("plain", "shown"),
    [
        ("steady (degC)", "steady (\u00b0C)"),
        ("degC", "\u00b0C"),
        ("8.1 degC/h", "8.1\u00a0\u00b0C/h"),
        ("in kg m2 (b)", "in kg\u00a0m\u00b2 (b)"),
        ("us", "\u00b5s"),
        ("let us see", "let us see"),
    ],
)
def test_units_of_columns_are_those_of_numbers(plain: str, shown: str) -> None:
    assert typeset(plain) == shown


def test_pictures_are_sound_svg_with_colours_by_meaning(html: str) -> None:
    pictures = re.findall(r"<svg.*?</svg>", html, re.DOTALL)
    assert len(pictures) == 4
    for picture in pictures:
        root = ElementTree.fromstring(picture)
        assert root.get("viewBox")
        assert root.get("aria-label")
        assert "var(--ink)" in picture
        for colour in PALETTE.values():
            assert colour.light not in picture
    assert "prefers-color-scheme:dark" in html
    assert "@media print" in html


def test_same_content_same_page(html: str, tmp_path: Path) -> None:
    page().write(tmp_path / "r.html")
    assert (tmp_path / "r.html").read_text() == html


def test_parts_that_are_missing_are_left_out() -> None:
    bare = page(before={}, after={}, curves=None, estimates=(), reference=None)
    assert structure(bare.html()).headings == []
    html = page(after={}, curves=(curve(1.0), None)).html()
    assert "error with compensation" not in html
    assert "Without compensation" not in html  # in the picture, as paths
    assert len(re.findall("<svg", html)) == 4


calibrated = partial(page, before={}, after={}, curves=None)
"""A page of a calibration alone."""


@pytest.mark.usefixtures("no_pictures")
def test_another_calibration_as_the_reference() -> None:
    one, reference = (("joint", estimate(0.0)),), ("calibration abc", estimate(0.01))
    assert "calibration abc" in calibrated(reference=reference, estimates=one).html()


@pytest.mark.usefixtures("no_pictures")
def test_an_order_that_only_one_knows_and_no_reference() -> None:
    other = estimate(0.0, amplitudes_Nm={16: 0.1, 32: 0.02})
    both = (("joint", estimate(0.0)), ("residual", other))
    html = calibrated(estimates=both, reference=None).html()
    assert "<tr><td>32</td><td></td>" in html


def test_many_orders_and_a_lone_point() -> None:
    many = estimate(0.0, None, dict.fromkeys(range(8, 8 * 14, 8), 0.01))
    html = page(
        before={(1.0, 0.5): 12.0},
        after={(1.0, 0.5): 1.5},
        curves=None,
        estimates=(("joint", many),),
        reference=None,
    ).html()
    assert "<b>12.00 % (interval not known)</b>" in html
    assert "<b>1.50 % (interval not known)</b>" in html


def test_settings_do_not_leak() -> None:
    before = mpl.rcParams["axes.spines.top"]
    with drawing():
        assert mpl.rcParams["axes.spines.top"] is False
    assert mpl.rcParams["axes.spines.top"] == before


def test_page_pieces() -> None:
    made = Page("t")
    made.paragraph("a < b")
    made.table(("x", "y"), [("1", "2")], numbers=True)
    html = made.html()
    assert "<p>a &lt; b</p>" in html
    assert '<table class="numbers"><thead>' in html
    structure(html)


def test_findings_stand_beneath_the_title_the_serious_first() -> None:
    made = Page("t", "of a motor")
    made.heading("Results")
    severities: tuple[Severity, ...] = ("note", "serious", "warning")
    made.findings(
        [Finding(f"a-{each}", 2.0, 1.0, "Nm", each, "it < that", "check it") for each in severities]
    )
    html = made.html()
    places = [html.index(text) for text in ("of a motor", "a-serious", "a-warning", "a-note")]
    assert places == sorted(places)
    assert html.index("a-note") < html.index("Results")
    assert "<p>It &lt; that.</p>" in html
    assert "serious \u00b7 2 Nm (limit 1)" in html
    structure(html)


def test_inline_keeps_clip_paths_apart() -> None:
    def draw() -> str:
        with figure(2.0) as picture:
            axes = picture.subplots()
            axes.plot([0, 1], [0, 1])
            axes.set_xlim(0.2, 0.8)
        return inline(picture, "p1", 'a "quoted" <label>')

    one = draw()
    assert "url(#p1-" in one
    assert 'aria-label="a &quot;quoted&quot; &lt;label&gt;"' in one
    ElementTree.fromstring(one)


OWN_LAYOUTS = ("figure.autolayout", "figure.constrained_layout.use")


@pytest.mark.parametrize("own", [{}, *({name: True} for name in OWN_LAYOUTS)])
def test_a_picture_is_laid_out_as_when_it_is_saved_and_drawn_once(own: dict[Any, bool]) -> None:
    """To save a figure with a layout of its own draws it twice: first to lay it out.

    own: what a person has in a matplotlibrc, where it is no matter of the picture.
    """

    def draw() -> tuple[Figure, list[Event]]:
        drawn: list[Event] = []
        with figure(2.0) as picture:
            left, right = picture.subplots(1, 2, width_ratios=[2.0, 1.0])
            left.set(ylabel="torque (Nm)", title="over angle", yscale="log", ylim=(1e-6, 1.0))
            right.plot([0, 1], [0, 1e3], label="of order 48")
            right.legend()
            picture.colorbar(right.pcolormesh([[0.0, 1.0]]), ax=right)
            picture.canvas.mpl_connect("draw_event", drawn.append)
        return picture, drawn

    (saved, twice), (shown, once) = draw(), draw()
    with drawing():
        saved.savefig(BytesIO(), format="svg")
    with mpl.rc_context(own):
        inline(shown, "p1", "")
    for one, other in zip(shown.axes, saved.axes, strict=True):
        assert one.get_position().bounds == other.get_position().bounds
    assert (len(twice), len(once)) == (2, 1)


@pytest.mark.parametrize("kinds", [*product(("part", "heading", "subheading"), repeat=4)])
def test_headings_are_in_order_however_a_page_is_put_together(kinds: tuple[str, ...]) -> None:
    made = Page("Title")
    for kind in kinds:
        getattr(made, kind)(kind)
    levels = structure(made.html()).levels
    assert len(levels) == 5
    assert levels[0] == 1
    assert all(1 < below <= above + 1 for above, below in pairwise(levels))


def test_sections_are_below_their_part() -> None:
    made = Page("Title")
    for kind in ("heading", "subheading", "part", "heading", "subheading", "part", "subheading"):
        getattr(made, kind)(kind)
    assert structure(made.html()).levels == [1, 2, 3, 2, 3, 4, 2, 3]


def test_headings_are_made_by_the_page_alone() -> None:
    root = Path(motord.__file__).parent
    found = [file for file in root.rglob("*.py") if re.search("<h[1-6]", file.read_text())]
    assert [str(file.relative_to(root)) for file in found] == ["report/html.py"]
