"""A package with a driver for slow channels, which says what a file says: installed for a test.

A number is a reading, `nan` a broken sensor; `hang` never returns, `raise` is an error in the
program, `fault` one of the device, `die` ends the process.
"""

import os
import threading
from pathlib import Path

from motord.config import ChannelConfig, Section
from motord.hal.base import DeviceError
from motord.hal.channel_source import RawSample, read_channel_settings

PACKAGE = "scripted_channels"
ENTRY_POINT = f"[motord.channels]\nscripted = {__name__}:Scripted\n"


class ScriptedSettings(Section):
    script: str


class Scripted:
    def __init__(self, channel: ChannelConfig) -> None:
        self._script = Path(read_channel_settings(ScriptedSettings, channel).script)

    def open(self) -> None:
        pass

    def read(self) -> RawSample | None:
        said = self._script.read_text().strip()
        match said:
            case "hang":
                self._script.write_text("40.5")
                threading.Event().wait()
            case "raise":
                raise ZeroDivisionError("a mistake")
            case "fault":
                raise DeviceError("the probe is off")
            case "die":
                os._exit(3)
            case "nothing":
                return None
        return RawSample(float(said))

    def close(self) -> None:
        pass


def install(folder: Path, monkeypatch) -> None:
    """Announce the driver to this process and to those that it starts."""
    info = folder / f"{PACKAGE}-1.0.dist-info"
    info.mkdir(exist_ok=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {PACKAGE}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(ENTRY_POINT)
    paths = [str(folder), str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, paths)))
    monkeypatch.syspath_prepend(str(folder))
