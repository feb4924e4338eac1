"""cyclictest, the yardstick of real-time Linux: its wake-up latencies, one by one."""

import shutil
import subprocess

from motord.loop.latency import LatencyError

PACKAGE = "rt-tests"
_PATIENCE_S = 30.0


def find() -> str:
    """Return where cyclictest is. Raises LatencyError that names the package to install."""
    path = shutil.which("cyclictest")
    if path is None:
        raise LatencyError(
            f"cyclictest is not installed; install the Debian package {PACKAGE} "
            f"(apt-get install {PACKAGE})"
        )
    return path


def command(path: str, *, period_us: int, loops: int, cpu: int, priority: int) -> list[str]:
    """Return the command line; `priority` 0 is normal priority."""
    policy = ["--policy=fifo", f"--priority={priority}"] if priority else ["--policy=other"]
    return [
        *(path, "--quiet", "--verbose", "--nsecs", "--threads=1", f"--affinity={cpu}"),
        *("--mlockall", f"--interval={period_us}", f"--loops={loops}", *policy),
    ]


def parse(text: str) -> list[int]:
    """Return the latencies in ns from lines `thread: cycle: latency`."""
    parts = [line.split(":") for line in text.splitlines()]
    return [int(p[2]) for p in parts if len(p) == 3 and all(x.strip().isdigit() for x in p)]


def run(path: str, *, period_us: int, loops: int, cpu: int, priority: int) -> list[int]:
    """Run `loops` cycles and return the latency of each in ns. Raises LatencyError."""
    arguments = command(path, period_us=period_us, loops=loops, cpu=cpu, priority=priority)
    limit_s = _PATIENCE_S + 10 * loops * period_us * 1e-6
    try:
        done = subprocess.run(arguments, capture_output=True, text=True, timeout=limit_s)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise LatencyError(f"{path}: {error}") from error
    latencies_ns = parse(done.stdout)
    if done.returncode != 0 or not latencies_ns:
        output = done.stderr.strip() or done.stdout.strip() or "it printed no latencies"
        raise LatencyError(f"{path} ended with code {done.returncode}: {output.splitlines()[-1]}")
    return latencies_ns
