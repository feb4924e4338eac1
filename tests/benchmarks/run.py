"""Run the benchmarks, print one table, write JSON.

    python -m tests.benchmarks.run [--json FILE] [--quick] [--strict] [NAME...]

A benchmark is a module `bench_NAME` of this folder with a function

    figures(quick: bool) -> list[Figure]

that measures and compares with the bounds it knows; `quick` asks for a shorter measurement that
need not be exact. A value of nan says that there was nothing to measure. A benchmark that fails
does not stop the others. The exit code is 1 if one failed or, with --strict, if a bound is not
kept or was not measured.
"""

import argparse
import json
import os
import pkgutil
import platform
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

from motord.loop.latency.measurement import stolen_ticks
from tests import benchmarks
from tests.benchmarks.figure import Figure

PREFIX = "bench_"
HEADINGS = ["what", "figure", "bound", "", "made of"]


@dataclass
class Results:
    """Figures by benchmark, and why the others failed."""

    figures: dict[str, list[Figure]] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    machine: dict[str, Any] = field(default_factory=dict)

    def rows(self) -> Iterator[list[str]]:
        """Return the rows of the table."""
        for figures in self.figures.values():
            for figure in figures:
                yield figure.row()

    @property
    def unmet(self) -> list[str]:
        """What does not keep its bound, or could not be measured."""
        every = [figure for figures in self.figures.values() for figure in figures]
        return [figure.what for figure in every if figure.bound is not None and not figure.met]

    def as_json(self) -> dict[str, Any]:
        """Return all of it for a file."""
        figures = [
            {"benchmark": name, **figure.as_json()}
            for name, several in self.figures.items()
            for figure in several
        ]
        return {"machine": self.machine, "figures": figures, "failed": self.failed}


def known() -> dict[str, Callable[[bool], list[Figure]]]:
    """Return the benchmarks of this folder by name."""
    found = {}
    for module in pkgutil.iter_modules(benchmarks.__path__):
        if module.name.startswith(PREFIX):
            figures = getattr(
                import_module(f"{benchmarks.__name__}.{module.name}"), "figures", None
            )
            if figures is not None:
                found[module.name.removeprefix(PREFIX)] = figures
    return found


def run(selected: dict[str, Callable[[bool], list[Figure]]], quick: bool) -> Results:
    """Run benchmarks one after the other; says on stderr which one it is at."""
    results = Results(machine=machine())
    begun_s, stolen_before = time.monotonic(), _stolen()
    for name, figures in selected.items():
        sys.stderr.write(f"benchmark {name}\n")
        try:
            results.figures[name] = figures(quick)
        except Exception as error:  # whatever it was, the others are still worth running
            first_line = (str(error).splitlines() or [""])[0]
            results.failed[name] = f"{type(error).__name__}: {first_line}"
            sys.stderr.write(f"  failed: {results.failed[name]}\n")
    took_s = time.monotonic() - begun_s
    cores = os.cpu_count() or 1
    ticks_per_s = os.sysconf("SC_CLK_TCK")
    stolen_s = (_stolen() - stolen_before) / ticks_per_s
    results.machine["took_s"] = round(took_s, 1)
    results.machine["stolen_percent"] = round(100 * stolen_s / (took_s * cores), 1)
    return results


def _stolen() -> int:
    return sum(stolen_ticks(cpu) for cpu in range(os.cpu_count() or 1))


def machine() -> dict[str, Any]:
    """Return on what the figures are measured."""
    return {
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "processor": processor(Path("/proc/cpuinfo")),
        "cores": os.cpu_count(),
        "kernel": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        **{name: version(name) for name in ("motord", "numpy", "numba")},
    }


def processor(cpuinfo: Path) -> str:
    """Return the processor's name."""
    lines = [line for line in cpuinfo.read_text().splitlines() if line.startswith("model name")]
    return lines[0].partition(":")[2].strip() if lines else platform.machine()


def table(rows: list[list[str]]) -> str:
    """Return rows under headings, columns aligned."""
    widths = [max(len(row[i]) for row in [HEADINGS, *rows]) for i in range(len(HEADINGS))]
    lines = [HEADINGS, ["-" * width for width in widths], *rows]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )


def main(arguments: list[str] | None = None) -> int:
    """Run what is asked for; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("names", nargs="*", metavar="NAME", help="benchmarks to run; default: all")
    parser.add_argument("--json", type=Path, help="write the results to this file")
    parser.add_argument("--quick", action="store_true", help="measure for a short time only")
    parser.add_argument("--strict", action="store_true", help="fail if a bound is not kept")
    options = parser.parse_args(arguments)
    selected = known()
    unknown = [name for name in options.names if name not in selected]
    if unknown:
        parser.error(f"no benchmark {unknown[0]!r}; there are {', '.join(selected)}")
    if options.names:
        selected = {name: selected[name] for name in options.names}
    results = run(selected, options.quick)
    machine = "  ".join(f"{key} {value}" for key, value in results.machine.items())
    sys.stdout.write(f"{machine}\n\n{table(list(results.rows()))}\n")
    for name, why in results.failed.items():
        sys.stdout.write(f"benchmark {name} failed: {why}\n")
    if options.json:
        options.json.write_text(json.dumps(results.as_json(), indent=1) + "\n")
    return 1 if results.failed or (options.strict and results.unmet) else 0


if __name__ == "__main__":
    sys.exit(main())
