"""Command lines that run motord's modules as processes of their own."""

import os
import sys


def module_command(module: str, *options: str) -> list[str]:
    """Return the command line of `module`, which loads nothing from the working folder.

    That is where people keep their own programs: a `queue.py` there would run in the loop.
    """
    return [sys.executable, "-P", "-m", module, *options]


def shield_from_working_folder() -> None:
    """Let no Python process that begins from now on load anything from the working folder.

    For those that others start: workers of `multiprocessing` and of Dask.
    """
    os.environ["PYTHONSAFEPATH"] = "1"
