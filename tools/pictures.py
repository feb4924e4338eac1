"""Make the pictures of the README from a demo, and of the profile: `make pictures`."""

import json
import sys
from pathlib import Path

from motord.experiments.plans import build
from motord.experiments.profile.command import estimate
from motord.experiments.profile.report import over_time
from motord.experiments.subject import Recordings
from motord.report.plots.mesh import rms_error
from motord.report.style import drawing
from motord.simulate import PlanSource, record_plan

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
    profile(demo_folder)


def profile(demo_folder: Path) -> None:
    """Play the example of a profile without compensation, and draw it over time."""
    source, run = PlanSource.of(), demo_folder / "profile.mcap"
    record_plan(source, build("profile", source.config, {"repeats": 1}), run, 1)
    found = estimate(Recordings.open([run]), demo_folder / "calibration.json")
    with drawing():
        picture = over_time(found.cycles[0])
        picture.savefig(IMAGES / "profile.png", dpi=110, facecolor="white")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
