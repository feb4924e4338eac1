"""A figure as SVG inside a page: scalable, without ids that clash, coloured by CSS variables."""

import re
from io import StringIO

from matplotlib.figure import Figure

from motord.report.style import PALETTE, drawing

_ID = re.compile(r' id="([^"]+)"')
_USED = re.compile(r'(?:url\(#|href="#)([^")]+)')


def inline(figure: Figure, prefix: str, description: str) -> str:
    """Return the `<svg>` element of a figure.

    prefix: makes the ids that are needed unique in the page; description: for screen readers.
    """
    buffer = StringIO()
    with drawing():
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    element = text[text.index("<svg") :]
    element = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", element, flags=re.DOTALL)
    element = re.sub(r"\n\s*", "\n", element)
    element = _unique_ids(element, prefix)
    for name, colour in PALETTE.items():
        element = element.replace(colour.light, f"var(--{name})")
    element = re.sub(r' width="[^"]*pt" height="[^"]*pt"', "", element, count=1)
    label = description.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
    return element.replace("<svg", f'<svg role="img" aria-label="{label}"', 1)


def _unique_ids(element: str, prefix: str) -> str:
    """Drop ids that nothing refers to, and put `prefix` before the others."""
    used = set(_USED.findall(element))

    def rename(match: re.Match[str]) -> str:
        return f' id="{prefix}-{match[1]}"' if match[1] in used else ""

    element = _ID.sub(rename, element)
    element = element.replace("url(#", f"url(#{prefix}-")
    return element.replace('href="#', f'href="#{prefix}-')
