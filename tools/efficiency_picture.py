"""Draw the efficiency map of the packaged efficiency bench: docs/images/efficiency-map.png.

`python tools/efficiency_picture.py map.mcap` draws what `motord simulate torque-speed -c
config/efficiency.toml -o map.mcap` has recorded.
"""

import sys
from pathlib import Path

from motord.experiments.subject import Recordings
from motord.experiments.torque_speed.recordings import efficiency_map
from motord.experiments.torque_speed.report import efficiency_contours
from motord.report.style import PAPER

FILE = Path(__file__).resolve().parent.parent / "docs/images/efficiency-map.png"


def main(recording: Path) -> None:
    """Draw the map of a recording."""
    found = efficiency_map(Recordings.open([recording]))
    efficiency_contours(found.points).savefig(FILE, dpi=110, facecolor=PAPER)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
