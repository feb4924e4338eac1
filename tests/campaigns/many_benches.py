"""How soon the loss of a bench or of a router is seen: `python -m tests.campaigns.many_benches`.

Three simulated daemons in real time, two on one router, one on another. In each of `--rounds` it
kills (-9) the daemon of a bench that is enabled by a plan, then the router in front of it, and
starts both again. Prints the times until a client of both routers sees each; exits with 1 if one
was over `LIMIT_S`, or if a bench that nothing was done to was lost.
"""

import argparse
import random
import statistics
import sys
import tempfile
from contextlib import ExitStack, closing, suppress
from pathlib import Path

from motord.client import Client, ClientError
from tests.campaigns import seeds
from tests.system.daemons import Daemon, wait_for
from tests.system.many_benches import (
    RouterProcess,
    Sightings,
    endpoint,
    kill_supervisor,
    running,
    start_plan,
)

LIMIT_S = 1.0
NAMES = ("one", "two", "three")


def campaign(rounds: int, seed: int) -> dict[str, list[float]]:
    """Return the times (s) until each kind of loss was seen."""
    choice, times = random.Random(seed), {"daemon killed": [], "router killed": [], "back": []}
    with tempfile.TemporaryDirectory() as base, ExitStack() as stack:
        folder = Path(base)
        daemons = stack.enter_context(running(folder, NAMES))
        near = RouterProcess(endpoint(), daemons["one"].endpoint, daemons["two"].endpoint)
        far = RouterProcess(endpoint(), daemons["three"].endpoint, near.listen)
        stack.callback(far.close)
        seen = stack.enter_context(closing(Sightings(near.listen, far.listen)))
        for name in NAMES:
            seen.since(0.0, name, True)
        for number in range(rounds):
            lost, kept = choice.sample(["one", "two"], 2)
            with daemons[lost].connect() as client:
                discard_plan(client)
                start_plan(client)
                wait_for(client, lambda s: s.state == "ENABLED", "the plan to enable")
            begun_s = kill_supervisor(daemons[lost])
            times["daemon killed"].append(seen.since(begun_s, lost, False))
            assert (kept, False) not in seen.times or seen.times[kept, False] < begun_s
            begun_s = near.close()
            times["router killed"].append(seen.since(begun_s, kept, False))
            near = RouterProcess(near.listen, *near.connect)
            times["back"].append(seen.since(begun_s, kept, True))
            path = folder / lost / f"{lost}.toml"
            daemons[lost] = Daemon(folder / lost, path)
            stack.callback(daemons[lost].close)
            seen.since(begun_s, lost, True)
            assert ("three", False) not in seen.times, "a bench was lost to which nothing was done"
            print(f"{number + 1} of {rounds}: " + say(times), flush=True)
        near.close()
    return times


def discard_plan(client: Client) -> None:
    """Forget the plan that a kill has interrupted, if there is one."""
    with client.lease("anna") as lease, suppress(ClientError):
        client.rpc("plan/discard", token=lease.token)


def say(times: dict[str, list[float]]) -> str:
    """Return median and largest of each kind."""
    return "; ".join(
        f"{what} after {statistics.median(found):.3f} s, at most {max(found):.3f} s"
        for what, found in times.items()
    )


def main() -> int:
    """Run the campaign."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--seed", type=int, default=seeds.first())
    given = parser.parse_args()
    times = campaign(given.rounds, given.seed)
    late = [t for what in ("daemon killed", "router killed") for t in times[what] if t > LIMIT_S]
    print(f"{len(late)} of {2 * given.rounds} losses were seen later than {LIMIT_S:g} s")
    return 1 if late else 0


if __name__ == "__main__":
    sys.exit(main())
