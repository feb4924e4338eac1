"""Is `make test` green everywhere? `python -m tests.campaigns.clones [--clones 10]`.

Makes fresh clones of what is committed, one after the other, each in a time zone of its own, so
that it is another time of day there, and runs `make test` in it while a process keeps every
processor busy. Prints what came of each and where its log is; exits with 1 if one is red.

`--idle` leaves the processors alone, and `--run` names another target.
"""

import argparse
import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

from tests.system.disturbances import hogs

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Result:
    """`said` is the last line of the log that counts tests, `forgiven` how many trips were."""

    zone: str
    green: bool
    seconds: float
    said: str
    forgiven: int


def zone(number: int, clones: int) -> str:
    """Return a time zone (POSIX) that is so many parts of a day east of UTC."""
    minutes = number * 24 * 60 // clones - 12 * 60
    sign = "-" if minutes >= 0 else "+"
    return f"CLONE{sign}{abs(minutes) // 60:02}:{abs(minutes) % 60:02}"


def clone(folder: Path) -> None:
    """Clone what is committed into `folder`."""
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(folder)], check=True)


def tried(folder: Path, command: list[str], log: Path, zone_: str) -> Result:
    """Run `command` in the clone."""
    environment = {**os.environ, "TZ": zone_, "PYTHONPATH": str(folder / "src")}
    begun_s = time.monotonic()
    with log.open("w") as out:
        ended = subprocess.run(
            command, cwd=folder, env=environment, stdout=out, stderr=subprocess.STDOUT
        )
    text = log.read_text(errors="replace")
    counts = re.findall(r"^\d+ (?:passed|failed).*$", text, re.M)
    forgiven = sum(map(int, re.findall(r"^(\d+) trips forgiven", text, re.M)))
    seconds = time.monotonic() - begun_s
    return Result(zone_, ended.returncode == 0, seconds, "; ".join(counts), forgiven)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clones", type=int, default=10)
    parser.add_argument("--idle", action="store_true", help="without busy processors")
    parser.add_argument("--run", default="make test")
    options = parser.parse_args()
    logs, red = Path(tempfile.mkdtemp(prefix="motord-clones-")), 0
    for number in range(options.clones):
        with tempfile.TemporaryDirectory(prefix="motord-clone-") as name:
            folder, log = Path(name) / "motord", logs / f"{number}.log"
            clone(folder)
            with nullcontext() if options.idle else hogs():
                result = tried(folder, shlex.split(options.run), log, zone(number, options.clones))
        red += not result.green
        sys.stdout.write(
            f"{number}: {'green' if result.green else 'RED'} in {result.seconds:.0f} s, "
            f"TZ={result.zone}, {result.forgiven} forgiven; {result.said}; {log}\n"
        )
        sys.stdout.flush()
    return 1 if red else 0


if __name__ == "__main__":
    sys.exit(main())
