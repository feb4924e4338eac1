"""Is `make test` green everywhere? `python -m tests.campaigns.clones [--clones 10]`.

Makes fresh clones of what is committed, `--at-once` so many at a time, each in a time zone of its
own, so that it is another time of day there, and runs `make test` in it, in a session of its own
as from a terminal of its own, while a process keeps every processor busy. What came of each, with
the commit, is in `results.json` of the folder `--out`, its log next to it; exits with 1 if one is
red.

Run again with the same `--out` it makes the clones that have not ended yet, with the same commit.
`--idle` leaves the processors alone, and `--run` names another target.
"""

import argparse
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import nullcontext, suppress
from dataclasses import asdict, dataclass
from datetime import datetime, timedelta
from pathlib import Path

from motord.atomic_write import write_whole
from tests.system.disturbances import hogs

ROOT = Path(__file__).resolve().parents[2]
POLL_S = 0.2


@dataclass(frozen=True)
class Result:
    """`counts` are the lines of the log that count tests, `forgiven` how many trips were."""

    number: int
    commit: str
    zone: str
    green: bool
    duration_s: float
    counts: list[str]
    forgiven: int
    log: str

    def __str__(self) -> str:
        outcome = "green" if self.green else "RED"
        return (
            f"{self.number}: {outcome} in {self.duration_s:.0f} s, TZ={self.zone}, "
            f"{self.forgiven} forgiven; {'; '.join(self.counts)}; {self.log}"
        )


def zone(number: int, clones: int) -> str:
    """Return a time zone (POSIX) that is so many parts of a day east of UTC."""
    minutes = number * 24 * 60 // clones - 12 * 60
    sign = "-" if minutes >= 0 else "+"
    return f"CLONE{sign}{abs(minutes) // 60:02}:{abs(minutes) % 60:02}"


def head(repository: Path) -> str:
    """Return the commit that is checked out."""
    command = ["git", "-C", str(repository), "rev-parse", "HEAD"]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def clone(repository: Path, folder: Path, commit: str) -> None:
    """Clone `commit` into `folder`."""
    subprocess.run(["git", "clone", "--quiet", str(repository), str(folder)], check=True)
    detach = ["git", "-C", str(folder), "checkout", "--quiet", "--detach", commit]
    subprocess.run(detach, check=True)


class Run:
    """`command` on its way in a clone of its own, which is deleted by `close`."""

    def __init__(self, number: int, commit: str, options: argparse.Namespace) -> None:
        self.number, self.commit = number, commit
        self.zone, self.log = zone(number, options.clones), options.out / f"{number}.log"
        self._parent = tempfile.TemporaryDirectory(
            prefix="motord-clone-", ignore_cleanup_errors=True
        )
        folder = Path(self._parent.name) / "motord"
        clone(options.repository, folder, commit)
        command = shlex.split(options.run)
        environment = {**os.environ, "TZ": self.zone, "PYTHONPATH": str(folder / "src")}
        self._begun_s = time.monotonic()
        with self.log.open("w") as out:
            self._process = subprocess.Popen(
                command, cwd=folder, env=environment, stdout=out, stderr=subprocess.STDOUT,
                start_new_session=True,
            )  # fmt: skip

    def result(self) -> Result | None:
        """Return what came of it, None while it runs."""
        code = self._process.poll()
        if code is None:
            return None
        duration_s = time.monotonic() - self._begun_s
        return result_of(self.number, self.commit, self.zone, (code == 0, duration_s), self.log)

    def close(self) -> None:
        """End what still runs, and delete the clone."""
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._parent.cleanup()


class Ended:
    """Whether Ctrl-C or SIGTERM came: asked for where nothing is half begun."""

    def __init__(self) -> None:
        self._came = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._come)

    def __bool__(self) -> bool:
        return self._came

    def _come(self, *_: object) -> None:
        self._came = True


def run_all(waiting: Iterable[Run], at_once: int, ended: Ended) -> Iterator[Result]:
    """Run so many at a time, each as one before it ends; yield what came of each as it ends."""
    waiting, running = iter(waiting), list[Run]()
    try:
        while not ended:
            while len(running) < at_once and (one := next(waiting, None)):
                running.append(one)
            if not running:
                return
            for one in list(running):
                if result := one.result():
                    running.remove(one)
                    one.close()
                    yield result
            time.sleep(POLL_S)
    finally:
        for one in running:
            one.close()


def result_of(number: int, commit: str, zone_: str, ended: tuple[bool, float], log: Path) -> Result:
    """Return what came of a clone, with what its log says of tests and forgiven trips."""
    text = log.read_text(errors="replace")
    counts = re.findall(r"^\d+ (?:passed|failed).*$", text, re.M)
    forgiven = sum(map(int, re.findall(r"^(\d+) trips forgiven", text, re.M)))
    return Result(number, commit, zone_, *ended, counts, forgiven, log.name)


def read(path: Path) -> list[Result]:
    """Return the results of a run before; none if there was none."""
    return [Result(**one) for one in json.loads(path.read_text())] if path.exists() else []


def write(path: Path, results: list[Result]) -> None:
    """Replace the file of results, whole."""
    write_whole(path, json.dumps([asdict(one) for one in results], indent=1) + "\n")


def progress(results: list[Result], clones: int, now: datetime, at_once: int = 1) -> str:
    """Return how far it is, and when the rest will be done if it takes as long as before."""
    left, red = clones - len(results), sum(not one.green for one in results)
    said = f"{len(results)} of {clones} clones, {red} red"
    if not results or not left:
        return said
    mean_s = sum(one.duration_s for one in results) / len(results)
    return f"{said}; the rest until about {now + timedelta(seconds=left / at_once * mean_s):%H:%M}"


def say(line: object) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clones", type=int, default=10)
    parser.add_argument("--at-once", type=int, default=1, help="so many clones at a time")
    parser.add_argument("--idle", action="store_true", help="without busy processors")
    parser.add_argument("--run", default="make test")
    parser.add_argument("--out", type=Path, help="folder of results; goes on where it ended")
    parser.add_argument("--repository", type=Path, default=ROOT, help="what is cloned")
    options = parser.parse_args()
    ended = Ended()
    out = options.out = options.out or Path(tempfile.mkdtemp(prefix="motord-clones-"))
    out.mkdir(parents=True, exist_ok=True)
    results = read(out / "results.json")
    commit = results[0].commit if results else head(options.repository)
    say(f"commit {commit}, results in {out}")
    for one in results:
        say(one)
    say(progress(results, options.clones, datetime.now()))
    left = sorted(set(range(options.clones)) - {one.number for one in results})
    runs = (Run(n, commit, options) for n in left)
    with nullcontext() if options.idle else hogs():
        for result in run_all(runs, options.at_once, ended):
            results.append(result)
            write(out / "results.json", results)
            say(result)
            say(progress(results, options.clones, datetime.now(), options.at_once))
    return int(bool(ended) or any(not one.green for one in results))


if __name__ == "__main__":
    sys.exit(main())
