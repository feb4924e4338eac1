"""Real-time rights of the loop process: all that can be had, and a loud account of the rest.

`apply` changes the calling process for the rest of its life; `probe` asks in a process of its own
and leaves nothing behind. docs/realtime.md says how a system grants each right.
"""

import platform
import subprocess
import sys
from pathlib import Path

from pydantic import BaseModel

from motord.config import LoopConfig
from motord.loop import rt_rights
from motord.loop.rt_rights import RealtimeItem
from motord.process.module_command import module_command


class Host:
    """The system files of a machine; `root` is another folder in tests."""

    def __init__(self, root: Path = Path("/")) -> None:
        self._root = root

    def text(self, path: str) -> str:
        """Return the content of a file without white space around it; "" if there is none."""
        try:
            return (self._root / path).read_text().strip()
        except OSError:
            return ""

    def number(self, path: str) -> int | None:
        """Return the number in a file, or None."""
        text = self.text(path)
        return int(text) if text.lstrip("-").isdigit() else None

    def under(self, folder: str, pattern: str) -> list[Path]:
        """Return the files under `folder` that fit, in order, from the root on."""
        found = sorted((self._root / folder).glob(pattern))
        return [path.relative_to(self._root) for path in found]


class RealtimeStatus(BaseModel, frozen=True):
    """All rights, and the system's kernel, preemption, real-time bandwidth and isolated CPUs."""

    items: list[RealtimeItem]
    kernel: str
    preemption: str
    rt_runtime_us: int | None
    rt_period_us: int | None
    isolated_cpus: str

    @property
    def granted(self) -> bool:
        """True if everything that was asked for was granted."""
        return all(item.granted for item in self.items)

    def lines(self) -> list[str]:
        """Return one line for each item."""
        return [item.line() for item in self.items]


def apply(loop: LoopConfig) -> RealtimeStatus:
    """Give the calling process the real-time rights of `[loop]`, each as far as granted.

    Call it when everything is loaded and compiled: it freezes the garbage collector and locks
    memory. The scheduler comes last, so that nothing before it runs with real-time priority.
    """
    items = [
        rt_rights.stop_garbage_collector(),
        rt_rights.set_timer_slack(),
        rt_rights.lock_memory(),
        rt_rights.keep_cpu_awake(),
        rt_rights.pin(loop.cpu),
        rt_rights.schedule(loop.priority),
    ]
    host = Host()
    return RealtimeStatus(
        items=items,
        kernel=f"{platform.system()} {platform.release()}",
        preemption=preemption(host.text("sys/kernel/realtime"), platform.version()),
        rt_runtime_us=host.number("proc/sys/kernel/sched_rt_runtime_us"),
        rt_period_us=host.number("proc/sys/kernel/sched_rt_period_us"),
        isolated_cpus=host.text("sys/devices/system/cpu/isolated"),
    )


def probe(loop: LoopConfig) -> RealtimeStatus:
    """Return what `apply` would be granted, asked in a short-lived process of its own."""
    answer = subprocess.run(
        module_command("motord.loop.rt_setup"),
        input=loop.model_dump_json(),
        capture_output=True,
        text=True,
        check=True,
    )
    return RealtimeStatus.model_validate_json(answer.stdout)


def preemption(realtime_flag: str, version: str) -> str:
    """Return the kernel's preemption model from /sys/kernel/realtime and `uname -v`."""
    if realtime_flag == "1":
        return "PREEMPT_RT"
    models = ("PREEMPT_RT", "PREEMPT_DYNAMIC", "PREEMPT")
    return next((model for model in models if model in version), "none")


def main() -> None:
    """Apply the rights of the `[loop]` given as JSON on stdin, print the status as JSON."""
    status = apply(LoopConfig.model_validate_json(sys.stdin.read()))
    sys.stdout.write(status.model_dump_json())


if __name__ == "__main__":
    main()
