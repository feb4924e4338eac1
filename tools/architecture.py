"""Draw the packages in their layers, into docs/images/architecture.svg: `make pictures`.

Layers are those of the import contract in pyproject.toml; a line from one package down to another
is as wide as the number of modules that import it says; those to what all import are left out.
"""

import math
import sys
import tomllib
from collections import Counter
from dataclasses import dataclass
from html import escape
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[1]
WIDTH, ROW, BOX_HEIGHT, LEFT = 1080, 74, 44, 150
LEAST_GAP = 6
INK, SOFT, PAPER, FILL, LINE = "#20242b", "#626b78", "#ffffff", "#f3f5f8", "#1670a8"

LAYERS = {
    "cli": "what people type",
    "reproduce": "Poels 2008 again",
    "dashboard": "pages and viewers",
    "client": "what others import",
    "service": "the supervisor",
    "api": "what both share",
    "verdict": "from many recordings",
    "experiments": "what is measured",
    "security": "who gets in",
    "recorder": "a process of its own",
    "recording": "files",
    "loop": "the real-time process",
    "shm": "shared memory",
    "hal": "devices and rigs",
    "can_interface": "python-can, opened",
    "control": "pure cores",
    "calibration": "what is applied",
    "config": "imported by nearly all",
}
"""What a layer is, by the first package in it."""

EVERYWHERE = {"config", "schema", "jit", "atomic_write", "process", "unix_clock"}
"""Imported nearly everywhere: lines to these would hide the others."""


@dataclass(frozen=True)
class Box:
    """A package: where it is drawn, and how many lines it has."""

    name: str
    x: float
    y: float
    width: float
    lines: int

    @property
    def middle(self) -> float:
        """Where lines begin and end."""
        return self.x + self.width / 2


def layers() -> list[list[str]]:
    """Return the packages of each layer, top first."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    contracts = project["tool"]["importlinter"]["contracts"]
    rows = next(c["layers"] for c in contracts if c["type"] == "layers")
    return [[name.strip().removeprefix("motord.") for name in row.split("|")] for row in rows]


def lines_of(package: str) -> int:
    """Return the number of lines of a package or module."""
    path = ROOT / "src" / "motord" / package
    files = path.rglob("*.py") if path.is_dir() else [path.with_suffix(".py")]
    return sum(len(file.read_text().splitlines()) for file in files)


def package_of(module: str) -> str:
    """Return the package below motord that a module belongs to, "" for motord itself."""
    return module.removeprefix("motord").lstrip(".").partition(".")[0]


def imports(packages: set[str]) -> Counter[tuple[str, str]]:
    """Return how many modules of one package import another, by (importer, imported)."""
    graph = grimp.build_graph("motord")
    found: Counter[tuple[str, str]] = Counter()
    for module in graph.modules:
        importer = package_of(module)
        names = graph.find_modules_directly_imported_by(module)
        used = {package_of(name) for name in names}
        found.update((importer, one) for one in used & packages if one != importer)
    return found


def _widths(names: list[str], counts: list[int]) -> list[float]:
    """Return the widths of boxes in a row: their names', and more by their lines, as it fits."""
    texts = [9.0 * len(name) + 16 for name in names]
    more = [max(2.0 * math.sqrt(n) + 50 - w, 0.0) for n, w in zip(counts, texts, strict=True)]
    room = WIDTH - LEFT - LEAST_GAP * (len(names) + 1) - sum(texts)
    part = min(1.0, room / max(sum(more), 1.0))
    return [text + part * extra for text, extra in zip(texts, more, strict=True)]


def boxes() -> dict[str, Box]:
    """Return the packages where they are drawn; the wider the more lines they have."""
    placed = {}
    for row, names in enumerate(layers()):
        counts = [lines_of(name) for name in names]
        widths = _widths(names, counts)
        gap = (WIDTH - LEFT - sum(widths)) / (len(names) + 1)
        # boxes that are alone in their layer stand left and right in turn, to show lines past them
        x = LEFT + gap * (1 if len(names) > 1 else 0.45 if row % 2 else 1.55)
        for name, count, width in zip(names, counts, widths, strict=True):
            placed[name] = Box(name, x, 20 + row * ROW, width, count)
            x += width + gap
    return placed


def _drawn(box: Box) -> str:
    return (
        f'<rect x="{box.x:.0f}" y="{box.y}" width="{box.width:.0f}" height="{BOX_HEIGHT}" '
        f'rx="5" fill="{FILL}" stroke="{SOFT}"/>'
        f'<text x="{box.middle:.0f}" y="{box.y + 19}" text-anchor="middle" fill="{INK}" '
        f'font-size="14" font-weight="600">{escape(box.name)}</text>'
        f'<text x="{box.middle:.0f}" y="{box.y + 35}" text-anchor="middle" fill="{SOFT}" '
        f'font-size="11">{box.lines:,} lines</text>'
    )


def svg() -> str:
    """Return the picture."""
    placed = boxes()
    rows = layers()
    parts = []
    for (importer, imported), count in sorted(imports(set(placed)).items()):
        if importer not in placed or imported in EVERYWHERE:
            continue
        a, b = placed[importer], placed[imported]
        y0, y1 = a.y + BOX_HEIGHT, b.y
        bend = (y1 - y0) / 2
        path = (
            f"M{a.middle:.0f},{y0:.0f} C{a.middle:.0f},{y0 + bend:.0f} "
            f"{b.middle:.0f},{y1 - bend:.0f} {b.middle:.0f},{y1:.0f}"
        )
        width = 0.5 + 0.45 * math.sqrt(count)
        parts.append(
            f'<path d="{path}" fill="none" stroke="{LINE}" stroke-opacity="0.28" '
            f'stroke-width="{width:.2f}"/>'
        )
    for row, names in enumerate(rows):
        y = 20 + row * ROW + BOX_HEIGHT / 2 + 4
        text = LAYERS.get(names[0], "")
        parts.append(f'<text x="12" y="{y:.0f}" fill="{SOFT}" font-size="12">{escape(text)}</text>')
    parts += map(_drawn, placed.values())
    height = 20 + len(rows) * ROW
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" '
        f'font-family="DejaVu Sans, sans-serif" role="img" aria-label="Packages of motord in their '
        f'layers, with their imports"><rect width="100%" height="100%" fill="{PAPER}"/>'
        + "".join(parts)
        + "</svg>\n"
    )


def main() -> None:
    """Write the picture."""
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "images" / "architecture.svg"
    out.write_text(svg(), encoding="utf-8")


if __name__ == "__main__":
    main()
