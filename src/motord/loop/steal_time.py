"""Time that the host of a virtual machine took from its processors, as /proc/stat counts it."""

from pathlib import Path

STAT = Path("/proc/stat")
_STEAL_COLUMN = 8


def stolen_ticks(cpu: int, stat: Path = STAT) -> int:
    """Return the steal counter of processor `cpu`, in ticks of usually 10 ms; 0 if not counted."""
    for line in stat.read_text().splitlines():
        columns = line.split()
        if columns and columns[0] == f"cpu{cpu}":
            return int(columns[_STEAL_COLUMN]) if len(columns) > _STEAL_COLUMN else 0
    return 0
