"""The images of the boards, built for the tests; skips where what it takes is not installed."""

import fcntl
import shutil
import subprocess
from functools import cache
from pathlib import Path

import pytest

FIRMWARE = Path(__file__).parents[2] / "firmware_bridge"
BUILD = FIRMWARE / "build"
PACKAGES = {
    "arm-none-eabi-gcc": "gcc-arm-none-eabi libnewlib-arm-none-eabi",
    "qemu-system-arm": "qemu-system-arm",
    "make": "make",
    "cppcheck": "cppcheck",
}


def need(*programs):
    """Skip the test, saying how to install it, if a program is missing."""
    for program in programs:
        if shutil.which(program) is None:
            pytest.skip(f"no {program}: apt install {PACKAGES[program]}")


def make(firmware, build, target="boards"):
    """Build a target of `firmware`; one process at a time. Return the folder of the images."""
    build.mkdir(exist_ok=True, parents=True)
    with (build / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        done = subprocess.run(
            ["make", "-C", str(firmware), target, f"BUILD={build}"],
            capture_output=True, text=True,
        )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return build / "boards"


@cache
def boards():
    """Return the folder with the images."""
    need("make", "arm-none-eabi-gcc")
    return make(FIRMWARE, BUILD)


def emulated(name="qemu"):
    """Return an image for QEMU."""
    need("qemu-system-arm")
    return boards() / f"{name}.elf"


def with_other_layout(folder):
    """Build the emulated board with another name for a field; return the image."""
    need("qemu-system-arm", "make", "arm-none-eabi-gcc")
    copy = folder / "firmware"
    shutil.copytree(FIRMWARE, copy, ignore=shutil.ignore_patterns("build"))
    header = copy / "protocol" / "bridge_frames.h"
    text = header.read_text()
    assert "FIELD(B, turns_enable)" in text
    header.write_text(text.replace("FIELD(B, turns_enable)", "FIELD(B, turns_enabled)"))
    core = copy / "core" / "bridge.c"
    core.write_text(core.read_text().replace("->turns_enable", "->turns_enabled"))
    build = folder / "build"
    return make(copy, build, f"{build}/boards/qemu.elf") / "qemu.elf"
