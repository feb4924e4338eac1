"""The options of a bench's processes, as `RunDir.command` writes them."""

import argparse
from pathlib import Path


def bench_options(name: str) -> argparse.ArgumentParser:
    """Return what reads --config FILE and --dir RUNDIR for a process."""
    parser = argparse.ArgumentParser(prog=f"motord {name}")
    parser.add_argument("--config", type=Path, required=True, help="bench file")
    parser.add_argument("--dir", type=Path, required=True, help="folder of the running bench")
    return parser
