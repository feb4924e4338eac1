"""The fenced blocks of README and docs, and what is to be done with each.

A block of TOML is read by what it is for (`READ_BY`), one of commands by the tree of commands,
one of Python is run (`RUN`). All others stand in `LISTED`, with the reason why nothing is done.
"""

from tools import code_blocks
from tools.code_blocks import ROOT, Block, commands, pages

FOLLOWED = ("docs/how-to/", "docs/notebook.md")
"""Pages whose Python and changes of the source are followed by `test_how_to`, `test_notebook`."""
COMMANDS = ("sh", "console")

__all__ = ["COMMANDS", "FOLLOWED", "ROOT", "Block", "blocks", "commands", "named", "of", "pages"]

READ_BY = {
    ("docs/faults.md", "[[fault]]"): "faults",
    ("docs/how-to/test-motors.md", 'motor = "axial-flux 48/16"'): "motor type",
    ("docs/how-to/queue-plans.md", "[[plan]]"): "queue",
    ("docs/import.md", 'motor = "motor.toml"            # [motor] and, if wanted,'): "map",
    ("docs/how-to/add-an-experiment.md", "[project.entry-points"): "experiments",
    ("docs/how-to/add-a-driver.md", '[project.entry-points."motord.drivers"]'): "entry points",
}
"""Blocks of TOML that are not part of a bench file; by the beginning of their first line."""

RUN = {
    ("docs/channels.md", "from pathlib import Path"): {
        "runs/bench-20250101T120000000Z-000.mcap": "{recording}"
    },
    ("docs/channels.md", "from motord.config import ChannelConfig, Section"): {},
    ("docs/api.md", "from motord.client import connect"): {},
    ("docs/api.md", "from motord.client import PlanEndedError, connect"): {
        '"turns": 2': '"turns": 2, "settle_s": 0.2, "spin_up": 1.0'  # sooner
    },
    ("docs/api.md", "import asyncio"): {},
    ("docs/api.md", "import json, zenoh"): {"tcp/127.0.0.1:7447": "{endpoint}"},
    ("docs/realtime.md", "from motord.shm.ring import RingReader"): {},
    ("docs/realtime.md", "from motord.shm.run_directory import RunDir"): {},
    ("docs/recording.md", "from pathlib import Path"): {
        "runs/bench-20250101T120000000Z-000.mcap": "{recording}"
    },
}
"""Blocks of Python, and what is put in place of what only a reader has. `PRINTED` says more."""

PRINTED = {
    ("docs/channels.md", "from pathlib import Path"): (),
    ("docs/channels.md", "from motord.config import ChannelConfig, Section"): (),
    ("docs/api.md", "from motord.client import connect"): ("OFF\n", "1.0 Nm, "),
    ("docs/api.md", "from motord.client import PlanEndedError, connect"): ("0% ", "recorded in "),
    ("docs/api.md", "import asyncio"): (" rad/s\n",),
    ("docs/api.md", "import json, zenoh"): ("OFF\n", '{"state":"OFF"'),
    ("docs/realtime.md", "from motord.shm.ring import RingReader"): (),
    ("docs/realtime.md", "from motord.shm.run_directory import RunDir"): (),
    ("docs/recording.md", "from pathlib import Path"): (),
}

_PRINTED = "what commands print: compared by tests/system/test_bring_up.py, which runs them"
LISTED = {
    "text": {
        "docs/how-to/play-a-profile.md": "a message, in unit/experiments/profile/test_checks.py",
        "docs/bring-up.md": _PRINTED,
        "docs/notebook.md": "what cells print, which differs from run to run: tools/notebook.py",
        "docs/first-calibration.md": "what commands print: test_first_calibration.py compares",
    },
    "ini": {
        "docs/security.md": "a drop-in of systemd with an address of a network that is not here",
    },
    "csv": {"docs/how-to/play-a-profile.md": "the beginning of config/profiles/short-cycle.csv"},
    "json": {
        "docs/how-to/many-benches.md": "zenohd is not here; tests run the other router",
    },
    "": {"docs/architecture.md": "a drawing"},
}
"""By language and file: blocks that are neither read nor run, and why."""

PROGRAMS = {
    "dask": "starts schedulers and workers on other machines",
    "sudo": "changes the computer",
    "apt": "changes the computer",
    "st-flash": "needs a board",
    "openocd": "needs a board",
    "dfu-util": "needs a board",
    "stm32flash": "needs a board",
    "cd": "goes to what make has built",
    "ip": "needs a CAN interface, and root",
    "sysctl": "needs root",
    "systemctl": "tests/system/test_systemd_unit.py does it",
    "systemd-sysusers": "tests/system/test_systemd_unit.py does it",
    "install": "tests/system/test_systemd_unit.py does it; what is copied has to be there",
    "udevadm": "needs root",
    "jq": "reads an archive that is not here",
    "sha256sum": "reads an archive that is not here",
    "python3": "sets up an environment",
    "node": "tests/languages runs it",
    "moteus_tool": "needs a drive; tests/unit/calibration_export/test_files.py runs its code",
    "rerun": "needs rerun-sdk; tests/campaigns/rerun_loader.py reads recordings with its loader",
    ".venv/bin/python": "tests/docs/test_how_to.py does it",
    "/opt/motord/bin/pip": "sets up an environment",
    "pip": "sets up an environment",
    "cp": "what is copied has to be there",
    "ls": "shows what is plugged in",
    ".": "activates the environment",
    "usermod": "changes the computer",
    "export": "sets a variable",
    "git": "needs a network",
    "ssh": "needs another machine",
    "cansend": "needs a CAN interface",
    "candump": "needs a CAN interface",
}
"""Programs of commands that are not run here, and why. `motord`, `make` and pytest are read."""


def blocks() -> list[Block]:
    return code_blocks.blocks(pages())


def of(*languages: str) -> list[Block]:
    """Return the blocks in these languages; `test_how_to` follows the others."""
    found = [block for block in blocks() if block.language in languages]
    return [b for b in found if not (b.language == "python" and b.file.startswith(FOLLOWED))]


def named(block: Block) -> str:
    return f"{block.file}:{block.line}"
