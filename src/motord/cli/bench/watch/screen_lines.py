"""The one widget: lines of text, of which only changed cells are sent to the terminal."""

from rich.segment import Segment
from rich.text import Text
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from motord.cli.bench.watch import layout
from motord.cli.bench.watch.glyphs import Glyphs
from motord.cli.bench.watch.snapshot import Snapshot


class ScreenLines(Widget):
    """The lines of `layout`."""

    DEFAULT_CSS = "ScreenLines { width: 100%; height: 100%; }"

    def __init__(self, glyphs: Glyphs) -> None:
        super().__init__()
        self._glyphs = glyphs
        self._lines: list[Text] = []

    def show(self, seen: Snapshot) -> None:
        """Draw a snapshot."""
        before, self._lines = self._lines, layout.lines(seen, *self.size, self._glyphs)
        for y, line in enumerate(self._lines):
            if y >= len(before):
                self.refresh(Region(0, y, self.size.width, 1))
            elif changed := changed_cells(before[y], line):
                first, last = changed
                self.refresh(Region(first, y, last - first, 1))

    def render_line(self, y: int) -> Strip:
        """Return a line of the screen."""
        line = self._lines[y] if y < len(self._lines) else Text()
        console = self.app.console
        styled = Segment.apply_style(line.render(console, end=""), console.get_style(line.style))
        return Strip(styled).adjust_cell_length(self.size.width)


def changed_cells(before: Text, after: Text) -> tuple[int, int] | None:
    """Return the first cell that changed and the one after the last, None if none did."""
    one, other = before.plain, after.plain
    same_style = before.style == after.style and before.spans == after.spans
    if same_style and one == other:
        return None
    if not same_style or len(one) != before.cell_len or len(other) != after.cell_len:
        return 0, max(before.cell_len, after.cell_len)
    width = max(len(one), len(other))
    one, other = one.ljust(width), other.ljust(width)
    differ = [x for x in range(width) if one[x] != other[x]]
    return (differ[0], differ[-1] + 1) if differ else None
