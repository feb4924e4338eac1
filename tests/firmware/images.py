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
    """Return the emulated board's image with another name for a field, of which it makes its hash.

    To build it takes two seconds; that the sources give the hash that is known here is shown by
    `test_frames` and `test_qemu_board`.
    """
    image = folder / "qemu.elf"
    data = emulated().read_bytes()
    assert data.count(b",turns_enable") == 1
    image.write_bytes(data.replace(b",turns_enable", b",turns_enabld"))
    return image
