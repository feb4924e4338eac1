"""Many recordings by Dask's workers: `python -m tests.campaigns.many_recordings [--recordings N]`.

N short recordings (1,000 by default) of motors of five types are made in virtual time, one of them
is cut off and one is text, and `motord analyse cogging FOLDER --store DIR` analyses them:

- by one worker, then by two: the same files, byte for byte, and two are at least 1.8 times as fast
  (on a computer with two processors and nothing else to do; --any-speed only prints it);
- by four workers, half of which are killed at random places, and their successors not: the same
  files again, every result once;
- once more, which does nothing, in less than 5 s; both files are named in every run.

Prints times and counts; exits with 1 if anything is not as said.
"""

import argparse
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil

from motord.results.store import ResultsStore
from tests.campaigns import seeds
from tests.campaigns.other_motors import rig_of
from tests.support.short_recordings import ShortRecording

TYPES = (("48/16", 1), ("star", 2), ("36/12", 3), ("48/16", 4), ("36/12", 5))
"""Motors, by the names of `other_motors` and the seeds of their rigs."""

TURNS = 10
WORKERS_TO_KILL = 4
FASTER = 1.8
NOTHING_S = 5.0
CUT, TEXT = "r00003.mcap", "text.mcap"


def make(folder: Path, count: int) -> None:
    """Write the recordings."""
    short = []
    for name, seed in TYPES:
        config, truth, *_ = rig_of(name, seed)
        motor = config.motor.model_copy(update={"name": f"{name} type {seed}"})
        config = config.model_copy(update={"motor": motor})
        short.append(ShortRecording.of(config, truth, turns=TURNS))
    for number in range(count - 1):
        where = folder / f"bench-{number % 7}"
        where.mkdir(exist_ok=True)
        short[number % len(short)].write(where / f"r{number:05d}.mcap", number)
    [cut] = folder.rglob(CUT)
    cut.write_bytes(cut.read_bytes()[:200])
    (folder / TEXT).write_text("no recording")


def analyse(
    runs: Path, store: Path, workers: int, meanwhile: Callable[[int], None] = lambda pid: None
) -> tuple[float, str, str]:
    """Return how long the command took (s), and what it printed, on stdout and stderr."""
    words = ["analyse", "cogging", str(runs), "--store", str(store), "--workers", str(workers)]
    begun_s = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, "-m", "motord", *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    meanwhile(process.pid)
    out, errors = process.communicate()
    return time.monotonic() - begun_s, out.strip(), errors.strip()


def results(store: Path) -> dict[str, bytes]:
    """Return the files of a store."""
    return {path.name: path.read_bytes() for path in store.glob("*.parquet")}


def killer(store: Path, count: int, rng: random.Random) -> Callable[[int], None]:
    """Return what kills half of the workers, each when a random share of all is done."""
    shares = sorted(rng.uniform(0.1, 0.8) for _ in range(WORKERS_TO_KILL // 2))

    def kill(parent: int) -> None:
        for share in shares:
            while len(list(store.glob("*.parquet"))) < share * count:
                time.sleep(0.05)
            victim = rng.choice(_workers(parent))
            victim.kill()
            print(f"  worker {victim.pid} killed at {100 * share:.0f} %", flush=True)

    return kill


def _workers(command: int) -> list[psutil.Process]:
    """Return the children of the fork server, which is a child of the command."""
    below = psutil.Process(command).children()
    [server] = [one for one in below if any("forkserver" in word for word in one.cmdline())]
    return server.children()


def main() -> None:
    """Make the recordings, analyse them again and again, and compare."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--recordings", type=int, default=1000)
    parser.add_argument("--any-speed", action="store_true")
    given = parser.parse_args()
    count, rng = given.recordings, random.Random(seeds.first())
    with tempfile.TemporaryDirectory() as name:
        wrong = list(_campaign(Path(name), count, rng, any_speed=given.any_speed))
    for line in wrong:
        print(f"WRONG: {line}")
    sys.exit(bool(wrong))


def _campaign(folder: Path, count: int, rng: random.Random, *, any_speed: bool) -> Iterator[str]:
    """Yield what is not as it should be."""
    runs, stores = folder / "runs", [folder / name for name in ("one", "two", "killed")]
    runs.mkdir()
    begun_s = time.monotonic()
    make(runs, count)
    print(f"{count} recordings made in {time.monotonic() - begun_s:.0f} s", flush=True)
    good = count - 2
    done = f"{count} recordings: {good} done, 0 skipped, 2 failed"
    again = f"{count} recordings: 0 done, {good} skipped, 2 failed"
    taken_s = []
    for store, workers, meanwhile, expected in (
        (stores[0], 1, None, done),
        (stores[1], 2, None, done),
        (stores[2], WORKERS_TO_KILL, killer(stores[2], count, rng), done),
        (stores[0], 2, None, again),
    ):
        needed_s, out, errors = analyse(runs, store, workers, meanwhile or (lambda pid: None))
        taken_s.append(needed_s)
        print(f"{workers} workers: {out}, in {needed_s:.1f} s", flush=True)
        if out != expected or CUT not in errors or TEXT not in errors:
            yield f"{workers} workers: {out}\n{errors}\nexpected: {expected}"
    first = results(stores[0])
    runs_named = {row["run"] for row in ResultsStore(stores[0]).read().table.to_pylist()}
    if len(first) != good or len(runs_named) != good:
        yield f"{len(first)} results of {len(runs_named)} recordings, of {good}"
    for store in stores[1:]:
        if results(store) != first:
            yield f"results of {store.name} are not those of one worker"
    print(f"two workers are {taken_s[0] / taken_s[1]:.2f} times as fast as one")
    if not any_speed and taken_s[0] < FASTER * taken_s[1]:
        yield f"not {FASTER} times as fast"
    if not any_speed and taken_s[3] > NOTHING_S:
        yield f"nothing to do took {taken_s[3]:.1f} s"


if __name__ == "__main__":
    main()
