"""One self-contained HTML page: headings, text, tables and pictures; nothing from elsewhere.

A figure is SVG inside the page: scalable, without ids that clash, coloured by CSS variables.
"""

import re
from collections.abc import Sequence
from html import escape as escape_markup
from io import StringIO
from pathlib import Path

from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from motord.atomic_write import write_whole
from motord.findings import Finding
from motord.report.style import PALETTE, drawing

_ID = re.compile(r' id="([^"]+)"')
_USED = re.compile(r'(?:url\(#|href="#)([^")]+)')

_SIGN = re.compile(r"(?:(?<=\d)|(?<=inf)|(?<=nan)) \+- (?=\d|inf|nan)|(?<![^\s(])\+-(?=\d)")
"""The sign of an interval as `intervals.plus_minus` writes it, and that of "(+-2 %)"."""
_MINUS = re.compile(r"(?<![^\s(\[])(?<!= )-(?=\d|inf\b)")
"""That of a number, which figures have as U+2212; a key of a file with its value is copied."""
_UNIT = re.compile(r"(?<=\d) (us|degC|deg)\b")
_UNITS = {"us": "\u00a0\u00b5s", "degC": "\u00a0\u00b0C", "deg": "\u00b0"}
"""Units that terminals and JSON have in ASCII; they stay on the line of their number."""
_UNIT_ALONE = re.compile(r"(?<=\()(us|degC)(?=\))|^(us|degC)$")
"""That of a column or an axis."""
_SQUARE = re.compile(r"\bkg m2\b")

_CSS = """
*{box-sizing:border-box}
body{margin:0;background:var(--paper);color:var(--ink);
 font:16px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,"DejaVu Sans",sans-serif}
main{max-width:62rem;margin:0 auto;padding:2rem 1.25rem 4rem}
h1{font-size:1.7rem;line-height:1.2;margin:0 0 .25rem}
h3,h4{font-size:1.05rem;margin:1.75rem 0 .25rem}
.section{font-size:1.2rem;margin:2.5rem 0 .5rem;padding-top:.5rem;border-top:1px solid var(--grid)}
.part{font-size:1.45rem;margin:4rem 0 .5rem;padding-top:.5rem;border-top:3px solid var(--ink)}
p{margin:.5rem 0;max-width:46rem}
.lead{color:var(--soft);margin-bottom:1rem}
figure{margin:1rem 0 1.5rem;break-inside:avoid}
figure svg{display:block;width:100%;min-width:36rem;height:auto}
figcaption{color:var(--soft);font-size:.9rem;max-width:46rem;margin-top:.25rem}
.wide{overflow-x:auto}
table{border-collapse:collapse;margin:1rem 0;font-size:.92rem;break-inside:avoid}
th,td{padding:.3rem .9rem .3rem 0;text-align:left;border-bottom:1px solid var(--grid);
 vertical-align:top}
th{font-weight:600}
table:not(.numbers) td:last-child{overflow-wrap:anywhere}
.numbers td:not(:first-child),.numbers th:not(:first-child){text-align:right;
 font-variant-numeric:tabular-nums;padding-left:.9rem;padding-right:0}
.cards{display:flex;flex-wrap:wrap;gap:1rem;margin:1.25rem 0}
.card{border:1px solid var(--grid);border-radius:.5rem;padding:.75rem 1rem;min-width:11rem}
.card b{display:block;font-size:1.5rem;line-height:1.2;font-variant-numeric:tabular-nums}
.card span{color:var(--soft);font-size:.88rem}
.finding{border:1px solid var(--grid);border-left:.4rem solid var(--grid);border-radius:.4rem;
 padding:.5rem .9rem;margin:.75rem 0;max-width:46rem;break-inside:avoid}
.finding.warning{border-left-color:var(--warning)}.finding.serious{border-left-color:var(--serious)}
.finding span{color:var(--soft);font-size:.88rem}.finding p{margin:.2rem 0}
.missing{border:2px solid var(--serious);border-left-width:.4rem}.missing b{color:var(--serious);
 font-size:1.1rem}
ul{margin:.5rem 0;padding-left:1.2rem;max-width:46rem}
@media print{figure svg{min-width:0}}
@media print{body{font-size:11px}main{max-width:none;padding:0}h2,h3,h4{break-after:avoid}}
"""

_SEVERITIES = ("serious", "warning", "note")


def inline(figure: Figure, prefix: str, description: str) -> str:
    """Return the `<svg>` element of a figure.

    prefix: makes the ids that are needed unique in the page; description: for screen readers.
    """
    buffer = StringIO()
    with drawing():
        _lay_out(figure)
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    element = text[text.index("<svg") :]
    element = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", element, flags=re.DOTALL)
    element = re.sub(r"\n\s*", "\n", element)
    element = _unique_ids(element, prefix)
    for name, colour in PALETTE.items():
        element = element.replace(colour.light, f"var(--{name})")
    element = re.sub(r' width="[^"]*pt" height="[^"]*pt"', "", element, count=1)
    return element.replace("<svg", f'<svg role="img" aria-label="{escape(description)}"', 1)


def _lay_out(figure: Figure) -> None:
    """Place the axes of a figure; `savefig` would draw all of it once more for that."""
    FigureCanvasSVG(figure)  # becomes that of the figure: texts are measured by it
    figure.dpi = FigureCanvasSVG.fixed_dpi
    layout = figure.get_layout_engine()
    if layout is not None and figure.axes:
        layout.execute(figure)
        figure.set_layout_engine(None)


def _unique_ids(element: str, prefix: str) -> str:
    """Drop ids that nothing refers to, and put `prefix` before the others."""
    used = set(_USED.findall(element))

    def rename(match: re.Match[str]) -> str:
        return f' id="{prefix}-{match[1]}"' if match[1] in used else ""

    element = _ID.sub(rename, element)
    element = element.replace("url(#", f"url(#{prefix}-")
    return element.replace('href="#', f'href="#{prefix}-')


def _variables(dark: bool) -> str:
    colours = (f"--{name}:{c.dark if dark else c.light}" for name, c in PALETTE.items())
    return ":root{" + ";".join(colours) + f";color-scheme:{'dark' if dark else 'light'}" + "}"


def _as_box(finding: Finding) -> str:
    """Return a finding: its name and size, what it means, what to do."""
    size = f"{finding.severity} \u00b7 {finding.size()}"
    return (
        f'<div class="finding {finding.severity}"><b>{escape(finding.name)}</b> '
        f"<span>{escape(size)}</span><p>{escape(_sentence(finding.meaning))}</p>"
        f"<p><em>{escape(_sentence(finding.action))}</em></p></div>"
    )


def _sentence(text: str) -> str:
    named = "_" in text.partition(" ")[0]  # a channel or a key, which has no other spelling
    begun = text if named else f"{text[:1].upper()}{text[1:]}"
    return begun + ("" if text.endswith(("?", ".")) else ".")


class Verbatim(str):
    """Text of a user, such as a note: it is escaped, and stays as it was written."""

    __slots__ = ()


class Markup(str):
    """Text that is markup already, and is not escaped."""

    __slots__ = ()


def escape(text: str) -> str:
    """Return text as markup; signs and units of numbers are as in figures, and on one line."""
    return escape_markup(text if isinstance(text, Verbatim) else typeset(text))


def typeset(text: str) -> str:
    """Return text of a terminal with the signs and units that figures have."""
    text = _MINUS.sub("\u2212", _SIGN.sub(_plus_minus_sign, text))
    text = _UNIT.sub(lambda match: _UNITS[match[1]], text)
    text = _UNIT_ALONE.sub(lambda match: _UNITS[match[0]].strip("\u00a0"), text)
    return _SQUARE.sub("kg\u00a0m\u00b2", text)


def _plus_minus_sign(match: re.Match[str]) -> str:
    return "\u00a0\u00b1\u00a0" if match[0].startswith(" ") else "\u00b1"


def _cell(text: str) -> str:
    return text if isinstance(text, Markup) else escape(text)


class Page:
    """A page that is put together from top to bottom, then written.

    All text is escaped, but for `Markup` in the rows of tables. Titles, leads and facts have names
    and paths of users, which stay as they are; `Verbatim` does so elsewhere.
    `lead` is a sentence under the title, `style` CSS after that of all pages.
    """

    def __init__(self, title: str, lead: str = "", style: str = "") -> None:
        self._title = Verbatim(title)
        self._style = style
        self._parts = [f"<h1>{escape(self._title)}</h1>"]
        self._missing: list[str] = []
        self._findings: list[str] = []
        self._pictures = 0
        self._in_part = False
        self._section = 1
        """Level of the heading that a subheading is of."""
        if lead:
            self._parts.append(f'<p class="lead">{escape(Verbatim(lead))}</p>')
        self._head = len(self._parts)

    def missing(self, name: str, lines: Sequence[str], action: str) -> None:
        """Show, beneath the title and before all findings, what the page's data lack."""
        items = "".join(f"<li>{escape(line)}</li>" for line in lines)
        self._missing.append(
            f'<div class="finding serious missing"><b>{escape(name)}</b><ul>{items}</ul>'
            f"<p><em>{escape(_sentence(action))}</em></p></div>"
        )

    def findings(self, findings: Sequence[Finding]) -> None:
        """Show, beneath the title, where the data depart from the model; the serious first."""
        ranked = sorted(findings, key=lambda one: _SEVERITIES.index(one.severity))
        self._findings = [_as_box(one) for one in ranked]

    def heading(self, text: str) -> None:
        """Begin a section, of the part under way if there is one."""
        self._section = 3 if self._in_part else 2
        self._parts.append(f'<h{self._section} class="section">{escape(text)}</h{self._section}>')

    def part(self, text: str) -> None:
        """Begin a part of several sections, which goes on until the next or the page's end."""
        self._in_part, self._section = True, 2
        self._parts.append(f'<h2 class="part">{escape(text)}</h2>')

    def subheading(self, text: str) -> None:
        """Begin a part of a section."""
        level = self._section + 1
        self._parts.append(f"<h{level}>{escape(text)}</h{level}>")

    def paragraph(self, text: str) -> None:
        """Add a paragraph."""
        self._parts.append(f"<p>{escape(text)}</p>")

    def points(self, items: Sequence[str]) -> None:
        """Add a list of sentences."""
        lines = "".join(f"<li>{escape(item)}</li>" for item in items)
        self._parts.append(f"<ul>{lines}</ul>")

    def cards(self, figures: Sequence[tuple[str, str]]) -> None:
        """Add key figures: (value with unit, what it is) each."""
        cards = "".join(
            f'<div class="card"><b>{escape(value)}</b><span>{escape(what)}</span></div>'
            for value, what in figures
        )
        self._parts.append(f'<div class="cards">{cards}</div>')

    def table(
        self, header: Sequence[str], rows: Sequence[Sequence[str]], *, numbers: bool = False
    ) -> None:
        """Add a table; with `numbers`, all columns but the first are set right."""
        head = "".join(f"<th>{escape(cell)}</th>" for cell in header)
        kind = ' class="numbers"' if numbers else ""
        self._table(kind, f"<thead><tr>{head}</tr></thead>", rows)

    def facts(self, rows: Sequence[Sequence[str]]) -> None:
        """Add a table of names and what they are, without a header; its text stays as it is."""
        self._table(
            "", "", [[c if isinstance(c, Markup) else Verbatim(c) for c in r] for r in rows]
        )

    def _table(self, kind: str, head: str, rows: Sequence[Sequence[str]]) -> None:
        body = "".join(
            "<tr>" + "".join(f"<td>{_cell(cell)}</td>" for cell in row) + "</tr>" for row in rows
        )
        self._parts.append(
            f'<div class="wide"><table{kind}>{head}<tbody>{body}</tbody></table></div>'
        )

    def picture(self, figure: Figure, caption: str) -> None:
        """Add a picture with its caption."""
        self._pictures += 1
        svg = inline(figure, f"p{self._pictures}", caption)
        text = f"<figcaption>{escape(caption)}</figcaption>"
        self._parts.append(f'<figure><div class="wide">{svg}</div>{text}</figure>')

    def html(self) -> str:
        """Return the whole page."""
        light, dark = _variables(dark=False), _variables(dark=True)
        style = f"{light}@media screen and (prefers-color-scheme:dark){{{dark}}}{_CSS}{self._style}"
        head, rest = self._parts[: self._head], self._parts[self._head :]
        return (
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width,initial-scale=1">'
            f"<title>{escape(self._title)}</title><style>{style}</style></head>\n<body><main>\n"
            + "\n".join([*head, *self._missing, *self._findings, *rest])
            + "\n</main></body></html>\n"
        )

    def write(self, path: Path) -> None:
        """Write the page; bytes of a file's name that are no text as escapes. Raises OSError."""
        write_whole(path, self.html().encode(errors="backslashreplace"))
