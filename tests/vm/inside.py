"""What runs in the machine: the drivers' contract over the kernel's CAN, then the tests in `inner`.

    python -m tests.vm.inside OUT

leaves OUT/results.xml (JUnit) and OUT/seconds, how long the machine took until here.
"""

import os
import sys
from pathlib import Path

INTERFACE = "vcan0"


def main(out: Path) -> int:
    (out / "seconds").write_text(Path("/proc/uptime").read_text().split()[0])
    os.environ["MOTORD_TEST_CAN"] = INTERFACE

    import pytest

    from tests.vm.inner import interface

    interface.make()
    return pytest.main(
        [
            *("-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-k", "can_socketcan or inner"),
            *("--durations=10", f"--junitxml={out / 'results.xml'}"),
            *("tests/contract/test_fast_drivers.py", "tests/vm/inner"),
        ]
    )


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
