"""Files: bench files, import maps, roles, calibrations, recordings."""

import json
import random
import tempfile
from collections.abc import Callable
from pathlib import Path

from motord.calibration import CalibrationError
from motord.calibration import load as load_calibration
from motord.cli.record.commands import _lines
from motord.config import ConfigError, load, packaged
from motord.experiments.operator_notes import add_operator_notes
from motord.experiments.subject import Recordings, motor_serial, plan_name
from motord.importing.mapping import load_map
from motord.recording import topics
from motord.recording.captures import captures
from motord.recording.errors import RecordError
from motord.recording.info import describe
from motord.recording.plan_columns import plan_columns
from motord.recording.reader import open_run
from motord.recording.recovery import recover
from motord.recording.writer import RunWriter
from motord.report.html import Page
from motord.security import roles
from motord.security.roles import Role, SecurityError
from tests.campaigns.fuzzing.mutate import mutate_bytes, mutate_json, mutate_text, some_bytes
from tests.support.calibrations import calibration
from tests.unit.importing.tables import MAP
from tests.unit.recording.runs import START_NS, point_of, tick_block, write_run

RECOVER_EVERY = 20


class File:
    """A file mutated and read, again and again; only errors of `explained` may come out.

    They say where: their message begins with the file, and is not empty after it.
    """

    def __init__(
        self,
        name: str,
        make: Callable[[random.Random], bytes],
        read: Callable[[Path], object],
        explained: type[Exception],
    ) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="motord-fuzz-", dir=_memory())
        self._path = Path(self._folder.name) / name
        self._make, self._read, self._explained = make, read, explained

    def close(self) -> None:
        """Remove the file."""
        self._folder.cleanup()

    def __call__(self, rng: random.Random) -> bool:
        content = self._make(rng) if rng.random() < 0.95 else some_bytes(rng, 3000)
        self._path.write_bytes(content)
        try:
            self._read(self._path)
        except self._explained as error:
            said = str(error)
        else:
            return True
        assert self._path.name in said, f"does not say which file: {said}"
        assert "Traceback" not in said
        return False


def _memory() -> str | None:
    return "/dev/shm" if Path("/dev/shm").is_dir() else None


def bench_file() -> File:
    """Bench files, mutated from those of the package."""
    emulated = packaged("../../../config/emulated.toml")
    texts = [packaged("sim.toml").read_text(), emulated.read_text()]
    texts = [
        text.replace('rig = "report.rig', 'rig = "package:report.rig').replace(
            'dbc = "', f'dbc = "{emulated.parent}/'
        )
        for text in texts
    ]
    return File("bench.toml", lambda rng: mutate_text(rng, rng.choice(texts)), load, ConfigError)


def import_map() -> File:
    """Maps of recordings from elsewhere."""
    more = MAP + '[csv]\nencoding = "utf-8"\ndecimal = ","\n'
    return File(
        "map.toml", lambda rng: mutate_text(rng, rng.choice((MAP, more))), load_map, ConfigError
    )


def roles_file() -> File:
    """Who may do what."""
    names = dict(zip("abcd", list(Role) * 2, strict=True))
    lines = "".join(f'"{name}" = "{role}"\n' for name, role in names.items())
    text = roles.HEADER + lines
    return File("roles.toml", lambda rng: mutate_text(rng, text), roles.read, SecurityError)


def calibration_file() -> File:
    """Calibrations, without the id, which would refuse what was changed before it is looked at."""
    content = {**calibration().to_json(), "id": ""}

    def make(rng: random.Random) -> bytes:
        if rng.random() < 0.5:
            return json.dumps(mutate_json(rng, content)).encode()
        return mutate_bytes(rng, json.dumps(content).encode())

    def read(path: Path) -> None:
        load_calibration(path).age()

    return File("calibration.json", make, read, CalibrationError)


def recording_json() -> File:
    """Recordings with an operating point, an event, a plan or motor that another program wrote."""
    ticks = tick_block(60)
    whole = {
        "point": point_of(ticks[10:50])
        | {"temperatures": {"coil": {"mean_C": 30.0}}, "turns": 2.0},
        "event": {"kind": "note", "message": "warm", "data": {"by": "anna"}},
        "plan": {"name": "calibrate", "settings": {"turns": 2}},
        "motor": {"name": "AFPM-7", "serial": "47"},
    }

    def make(rng: random.Random) -> bytes:
        changed = rng.choice(list(whole))
        content = {**whole, changed: mutate_json(rng, whole[changed])}
        with tempfile.TemporaryDirectory(dir=_memory()) as folder:
            path = Path(folder) / "run.mcap"
            with RunWriter(path, {name: content[name] for name in ("plan", "motor")}) as writer:
                writer.ticks(ticks)
                for topic, name in ((topics.OPERATING_POINTS, "point"), (topics.EVENTS, "event")):
                    if isinstance(content[name], dict):
                        writer._message(topic, START_NS, content[name])
            return path.read_bytes()

    def read(path: Path) -> None:
        run = open_run(path)
        list(captures(run))
        plan_name(run), motor_serial(run), plan_columns(run.metadata)
        list(_lines(describe(run)))
        add_operator_notes(Page("notes"), Recordings((run,)))

    return File("run.mcap", make, read, RecordError)


def recording() -> File:
    """Recordings: opened, checked, read whole, now and then recovered."""
    with tempfile.TemporaryDirectory() as folder:
        originals = []
        for name, options in (("z", {"chunk_s": 0.05}), ("n", {"compression": "none"})):
            write_run(Path(folder) / f"{name}.mcap", 120, **options)
            originals.append((Path(folder) / f"{name}.mcap").read_bytes())
    turn = iter(range(1 << 62))

    def read(path: Path) -> None:
        run = open_run(path)
        run.check()
        run.ticks()
        run.truth() if run.truth_table.present else None
        run.events(), run.plan(), run.operating_points()
        if next(turn) % RECOVER_EVERY == 0:
            clean = path.with_name("clean.mcap")
            clean.unlink(missing_ok=True)
            recover(path, clean)
            again = open_run(clean)
            assert again.check() is None, "what was recovered is damaged"

    return File(
        "run.mcap", lambda rng: mutate_bytes(rng, rng.choice(originals), 4), read, RecordError
    )
