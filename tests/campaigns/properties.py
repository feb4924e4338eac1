"""The property tests with examples by chance: `python -m tests.campaigns.properties [--rounds 3]`.

`make test` draws the same examples every time. Here every round has a seed of its own, from SEED
on, which is printed; exits with 1 if an example was found that fails.
"""

import argparse
import os
import subprocess
import sys

from tests.campaigns import seeds


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--jobs", default="2")
    parser.add_argument("paths", nargs="*", default=["tests"])
    options = parser.parse_args()
    environment = {**os.environ, "MOTORD_HYPOTHESIS": "soak"}
    failed = 0
    for seed in seeds.several(options.rounds):
        sys.stdout.write(f"hypothesis seed {seed}\n")
        sys.stdout.flush()
        command = [sys.executable, "-m", "pytest", "-q", "-m", "hypothesis", "-n", options.jobs]
        command += ["--dist", "loadfile", f"--hypothesis-seed={seed}", *options.paths]
        failed |= subprocess.run(command, env=environment).returncode
    return failed


if __name__ == "__main__":
    sys.exit(main())
