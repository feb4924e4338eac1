"""Make the pictures of the README from a demo: `make pictures`."""

import json
import sys
from pathlib import Path

from motord.report.plots.mesh import rms_error
from motord.report.style import drawing

IMAGES = Path(__file__).resolve().parent.parent / "docs" / "images"


def main(demo_folder: Path) -> None:
    """Draw the mesh before and after from the folder of a demo."""
    found = json.loads((demo_folder / "demo.json").read_text())
    panels = [
        (title, {(p["torque_Nm"], p["speed_Hz"]): p[key] for p in found["points"]})
        for title, key in (("Without compensation", "before"), ("With compensation", "after"))
    ]
    IMAGES.mkdir(parents=True, exist_ok=True)
    with drawing():
        rms_error(panels).savefig(IMAGES / "before-after.png", dpi=130, facecolor="white")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
