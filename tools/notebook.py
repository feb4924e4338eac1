"""Make docs/notebook.md and its pictures from docs/notebook.py: `make pictures`.

    python tools/notebook.py [--check]

The script is run, cell by cell, against a simulated bench; what a cell prints and draws stands
below it. `--check` runs nothing: it says whether prose, code and pictures of the page are those of
the script.
"""

import io
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any
from unittest import mock

import matplotlib as mpl

DOCS = Path(__file__).resolve().parent.parent / "docs"
SCRIPT, PAGE, IMAGES = DOCS / "notebook.py", DOCS / "notebook.md", DOCS / "images"
ENDPOINT = "tcp/127.0.0.1:17447"


@dataclass(frozen=True)
class Cell:
    """A cell of the script: prose without its `# `, or code."""

    is_code: bool
    text: str


@dataclass(frozen=True)
class Shown:
    """What a cell printed, and the names of the pictures that it drew."""

    printed: str = ""
    pictures: tuple[str, ...] = ()


def cells(script: str) -> list[Cell]:
    """Return the cells of a script in percent format."""
    found = []
    for part in re.split(r"^# %%", script, flags=re.M)[1:]:
        head, _, body = part.partition("\n")
        if "[markdown]" in head:
            lines = (re.sub(r"^# ?", "", line) for line in body.strip().split("\n"))
            found.append(Cell(False, "\n".join(lines)))
        else:
            found.append(Cell(True, body.strip()))
    return found


def run(script: str, images: Path) -> list[Shown]:
    """Run the script, save its pictures in `images` and return what each cell shows."""
    mpl.use("agg")
    import matplotlib.pyplot as plt

    from motord.report.style import drawing

    namespace: dict[str, Any] = {"__name__": "notebook"}
    shown, number = [], 0
    for cell in cells(script):
        said, pictures = io.StringIO(), []
        if cell.is_code:
            with redirect_stdout(said), drawing():
                exec(compile(cell.text, str(SCRIPT), "exec"), namespace)
                for figure in plt.get_fignums():
                    number += 1
                    pictures.append(f"notebook-{number}.png")
                    plt.figure(figure).savefig(images / pictures[-1], dpi=130, facecolor="white")
                plt.close("all")
        shown.append(Shown(said.getvalue(), tuple(pictures)))
    return shown


def page(script: str, shown: list[Shown]) -> str:
    """Return the page of a script whose cells showed that."""
    parts = ["<!-- Made from notebook.py by tools/notebook.py: change that. -->"]
    for cell, below in zip(cells(script), shown, strict=True):
        parts.append(f"```python\n{cell.text}\n```" if cell.is_code else cell.text)
        if below.printed:
            parts.append(f"```text\n{below.printed}```")
        parts += [f"![{alt(cell)}](images/{name})" for name in below.pictures]
    return "\n\n".join(parts) + "\n"


def alt(cell: Cell) -> str:
    """Return what a picture shows: the first title in the cell that drew it."""
    title = re.search(r"title(?:=|\()f?\"([^\"]+)\"", cell.text)
    return re.sub(r"\{\w+\}", "", title[1]).replace("  ", " ") if title else "Plot"


def without_output(text: str) -> str:
    """Return a page without what its cells printed, which differs from run to run."""
    return re.sub(r"^```text\n.*?^```\n\n", "", text, flags=re.M | re.S)


def pictures(text: str) -> list[str]:
    """Return the names of the pictures of a page."""
    return re.findall(r"\]\(images/(notebook-\d+\.png)\)", text)


def errors(script: str, text: str) -> Iterator[str]:
    """Yield in what a page is not that of the script, whose drawing cells draw one picture each."""
    draws = [cell.is_code and "plt.subplots" in cell.text for cell in cells(script)]
    names = (f"notebook-{number}.png" for number in count(1))
    expected = [Shown(pictures=(next(names),) if each else ()) for each in draws]
    if without_output(text) != page(script, expected):
        yield f"{PAGE.name} is not what {SCRIPT.name} gives: run tools/notebook.py"


@contextmanager
def simulated_bench() -> Iterator[None]:
    """Run the daemon of the packaged simulated bench, which `connect()` finds then."""
    from motord import config

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        text = config.packaged("sim.toml").read_text()
        text = text.replace('rig = "report.rig.toml"', 'rig = "package:report.rig.toml"')
        (folder / "sim.toml").write_text(f'{text}\n[zenoh]\nlisten = ["{ENDPOINT}"]\n')
        own = {"XDG_RUNTIME_DIR": name, "XDG_STATE_HOME": name, "MOTORD_CONNECT": ENDPOINT}
        command = [sys.executable, "-m", "motord", "run", "-c", "sim.toml", "--json"]
        with mock.patch.dict(os.environ, own):
            daemon = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE)
            try:
                assert daemon.stdout is not None
                assert daemon.stdout.readline(), "the daemon has not started"
                yield
            finally:
                daemon.terminate()
                daemon.communicate()


def main(arguments: list[str]) -> int:
    """Make the page, or check it."""
    script = SCRIPT.read_text()
    if arguments == ["--check"]:
        found = list(errors(script, PAGE.read_text()))
        sys.stderr.writelines(f"{error}\n" for error in found)
        return 1 if found else 0
    with simulated_bench():
        PAGE.write_text(page(script, run(script, IMAGES)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
