"""Does an operator's set-point, where it is not refused, trip the bench?

`python -m tests.campaigns.legal_operation [--seed 0] [--draws 40] [--benches]`: torques and speeds
are set one after the other, at random and at random times, on the packaged bench in virtual time;
with --benches on one that is drawn. A trip is a finding, and printed with what led to it.
"""

import argparse
import sys

import numpy as np

from motord.api.errors import RpcError
from motord.schema import State
from motord.virtual import VirtualBench
from tests.campaigns import seeds
from tests.campaigns.legal_settings import bench, bench_changes
from tests.unit.service.virtual_service import VirtualService

CHANGES = 12
WAIT_S = (0.1, 6.0)

Change = dict[str, float]


def change(rng: np.random.Generator, most_Hz: float, held_Hz: float) -> Change:
    """Return a torque with a speed, a torque at the speed that is held, or no torque."""
    kind, torque_Nm = rng.choice(["point", "point", "torque", "rest"]), rng.uniform(0.8, 6.0)
    if kind == "rest" or (kind == "torque" and not held_Hz):
        return {"torque_Nm": 0.0}
    if kind == "torque":
        return {"torque_Nm": round(float(np.copysign(torque_Nm, held_Hz)), 2)}
    sign = float(rng.choice([-1, 1]))
    return {
        "torque_Nm": round(sign * float(torque_Nm), 2),
        "speed_Hz": round(sign * float(rng.uniform(0.3, most_Hz)), 2),
    }


def operated(seed: int, *, benches: bool) -> tuple[str, list[tuple[Change, str, float]]]:
    """Set points; return the trip, "" if there was none, and what was set, refused, and for how
    long (s)."""
    config, truth = bench(bench_changes(seed) if benches else {}, seed)
    service = VirtualService(
        bench_config=config, virtual=VirtualBench(config, truth, seed=seed), safe=True
    )
    token, rng = service.enabled(), np.random.default_rng([seed, 3])
    trip_rad_s, critical_rad_s = config.limits.trip_speed_rad_s, config.brake.critical_speed_rad_s
    most_Hz = min(0.8 * trip_rad_s, 0.9 * critical_rad_s) / (2 * np.pi)
    held_Hz, done = 0.0, []
    for _ in range(CHANGES):
        asked, refusal, for_s = change(rng, most_Hz, held_Hz), "", float(rng.uniform(*WAIT_S))
        try:
            service.ask("set", token=token, **asked)
            held_Hz = asked.get("speed_Hz", held_Hz)
        except RpcError as error:
            refusal = str(error)
        service.run_s(for_s, token)
        done.append((asked, refusal, round(for_s, 2)))
        if service.bench.state is not State.ENABLED:
            report = service.bench.monitor.trip
            return (" ".join(report.causes) if report else service.bench.state.name), done
    return "", done


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=seeds.first(0))
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--benches", action="store_true", help="draw the bench, too")
    options = parser.parse_args()
    tripped = 0
    for seed in range(options.seed, options.seed + options.draws):
        trip, done = operated(seed, benches=options.benches)
        if trip:
            tripped += 1
            print(f"{seed}: {trip}", *done, sep="\n    ", flush=True)
    print(f"{tripped} of {options.draws} tripped")
    return int(tripped > 0)


if __name__ == "__main__":
    sys.exit(main())
