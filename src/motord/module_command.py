"""Command lines that run motord's modules as processes of their own."""

import sys


def module_command(module: str, *options: str) -> list[str]:
    """Return the command line of `module`, which loads nothing from the working folder.

    That is where people keep their own programs: a `queue.py` there would run in the loop.
    """
    return [sys.executable, "-P", "-m", module, *options]
