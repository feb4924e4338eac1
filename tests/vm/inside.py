"""What runs in the machine.

    python -m tests.vm.inside tests OUT     the contract over the kernel's CAN, then `inner`
    python -m tests.vm.inside cost OUT      what a tick costs (`tests.vm.cost`)

leaves OUT/seconds, how long the machine took until here, and OUT/results.xml (JUnit) or
OUT/cost.json. Coverage is not measured: it would take several times as long there.
"""

import json
import os
import sys
from pathlib import Path

INTERFACE = "vcan0"
RECEIVE_BUFFER_BYTES = 1 << 22
"""May be asked for by sockets: here it takes long until everything is open and read."""
os.environ.setdefault("MOTORD_TEST_CAN", INTERFACE)


def run_tests(out: Path) -> int:
    import pytest

    return pytest.main(
        [
            *("-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-k", "socketcan or inner"),
            *("--durations=10", f"--junitxml={out / 'results.xml'}"),
            *("tests/contract/test_fast_drivers.py", "tests/vm/inner"),
        ]
    )


def measure(out: Path) -> int:
    from tests.vm import cost

    (out / "cost.json").write_text(json.dumps(cost.measure(INTERFACE)))
    return 0


def main(what: str, out: Path) -> int:
    from tests.vm.inner import interface

    (out / "seconds").write_text(Path("/proc/uptime").read_text().split()[0])
    Path("/proc/sys/net/core/rmem_max").write_text(str(RECEIVE_BUFFER_BYTES))
    interface.make()
    return {"tests": run_tests, "cost": measure}[what](out)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], Path(sys.argv[2])))
