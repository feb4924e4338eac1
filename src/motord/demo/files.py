"""Where a demo puts what it makes."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Files:
    """What a demo leaves behind in its folder."""

    folder: Path

    @property
    def before(self) -> Path:
        """The mesh without compensation."""
        return self.folder / "verify-off.mcap"

    @property
    def calibrate(self) -> Path:
        """The run that the calibration came from."""
        return self.folder / "calibrate.mcap"

    @property
    def after(self) -> Path:
        """The mesh with compensation."""
        return self.folder / "verify-on.mcap"

    @property
    def calibration(self) -> Path:
        """The calibration file."""
        return self.folder / "calibration.json"

    @property
    def result(self) -> Path:
        """What `demo --json` prints."""
        return self.folder / "demo.json"

    @property
    def report(self) -> Path:
        """The report."""
        return self.folder / "report.html"

    @property
    def runs(self) -> tuple[Path, Path, Path]:
        """The recordings in the order in which they were taken."""
        return self.before, self.calibrate, self.after

    def remove(self) -> None:
        """Remove what an earlier demo left here."""
        for file in (*self.runs, self.calibration, self.result, self.report):
            file.unlink(missing_ok=True)
            file.with_name(f"{file.name}.part").unlink(missing_ok=True)
