"""Make the picture of a soak, from a short one on the simulated rig: `make pictures`."""

import sys
from pathlib import Path

from motord.experiments.plans import build
from motord.experiments.soak.estimate import soak_trends
from motord.experiments.soak.report import over_time
from motord.experiments.subject import Recordings
from motord.report.style import drawing
from motord.simulate import PlanSource, record_plan

IMAGE = Path(__file__).resolve().parent.parent / "docs" / "images" / "soak.png"

SETTINGS = {
    "plan": "verify", "repeats": 16, "pause_s": 5.0, "compensate": "off",
    "inner": {"torques_Nm": [3.0, 5.0], "speeds_Hz": [2.0], "turns": 6},
}  # fmt: skip


def main(run: Path) -> None:
    """Repeat two operating points, record them in `run`, draw their figures over time."""
    source = PlanSource.of()
    record_plan(source, build("soak", source.config, SETTINGS), run, 1)
    with drawing():
        picture = over_time(soak_trends(Recordings.open([run])))
        picture.savefig(IMAGE, dpi=100, facecolor="white")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
