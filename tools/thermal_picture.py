"""Draw a heat-up and its cooling on the packaged thermal bench: docs/images/thermal.png.

`python tools/thermal_picture.py heat.mcap` draws what `motord simulate thermal -c
config/thermal.toml -o heat.mcap` has recorded.
"""

import sys
from pathlib import Path

from motord.experiments.subject import Recordings
from motord.experiments.thermal.command import estimate
from motord.experiments.thermal.report import temperatures
from motord.report.style import PAPER

FILE = Path(__file__).resolve().parent.parent / "docs/images/thermal.png"


def main(recording: Path) -> None:
    """Draw what a recording has."""
    found = estimate(Recordings.open([recording]))
    temperatures(found).savefig(FILE, dpi=110, facecolor=PAPER)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
