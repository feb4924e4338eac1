"""Commands that serve viewers: the page in the browser, Foxglove; pages opened for a person."""

import os
import sys

NICE = 5
"""Of programs that show a bench: daemon and recorder go first."""


def open_page(url: str) -> bool:
    """Open a page in the browser; return whether one took it.

    Only where somebody sits: a terminal and a display. A browser of the terminal, which would take
    it over, is not asked.
    """
    if not (sys.stdin.isatty() and sys.stdout.isatty()) or "CI" in os.environ:
        return False
    if sys.platform != "darwin" and not ({"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys()):
        return False
    import webbrowser

    try:
        return webbrowser.open(url)
    except webbrowser.Error:
        return False
