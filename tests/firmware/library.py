"""Protocol and core of the firmware as a shared library of this machine, for tests.

The declarations that cffi reads are what the preprocessor makes of the firmware's own headers.
With MOTORD_FIRMWARE_BUILD set to a folder, the library there is taken (`tests.firmware.coverage`
puts one that counts there).
"""

import os
import re
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import cffi
import pytest

ROOT = Path(__file__).resolve().parents[2]
FIRMWARE = ROOT / "firmware_bridge"
C_TESTS = Path(__file__).resolve().parent / "c"
HOST_SOURCE = C_TESTS / "host.c"
FLAGS = (
    *("-std=c11", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Wundef", "-Wvla"),
    *("-Wstrict-prototypes", "-Wmissing-prototypes", "-Werror"),
    *(f"-I{FIRMWARE}", f"-I{C_TESTS}"),
)


def needs(command: str, package: str) -> str:
    """Return the path of `command`; skip the test where it is missing."""
    path = shutil.which(command)
    if path is None:
        pytest.skip(f"{command} is missing; apt install {package}")
    return path


def sources() -> list[Path]:
    """Return the C sources of protocol and core."""
    return sorted([*FIRMWARE.glob("protocol/*.c"), *FIRMWARE.glob("core/*.c")])


def run(*command: object, cwd: Path = ROOT, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run a command that has to succeed; what it printed is in the failure's message."""
    arguments = [str(argument) for argument in command]
    done = subprocess.run(
        arguments, cwd=cwd, capture_output=True, text=True, check=False, **options
    )
    assert done.returncode == 0, f"{' '.join(arguments)}\n{done.stdout}{done.stderr}"
    return done


@cache
def declarations() -> str:
    """Return the declarations of the headers, as cffi reads them."""
    text = run(
        needs("gcc", "gcc"), "-E", "-P", "-nostdinc", "-D_Atomic=", f"-I{C_TESTS / 'stub'}",
        f"-I{FIRMWARE}", f"-I{C_TESTS}", C_TESTS / "host.h",
    ).stdout  # fmt: skip
    return re.sub(r"_Static_assert\(.*?\);", "", text, flags=re.DOTALL)


def compile_library(out: Path, *flags: str, changed: dict[Path, Path] | None = None) -> Path:
    """Build the library; `changed` names files that stand in for some of the sources."""
    chosen = [(changed or {}).get(source, source) for source in sources()]
    gcc = needs("gcc", "gcc")
    run(gcc, *FLAGS, *flags, "-fPIC", "-shared", "-o", out, *chosen, HOST_SOURCE)
    return out


class Library:
    """The loaded library: `lib`, and the `ffi` that makes its structures."""

    def __init__(self, path: Path) -> None:
        self.ffi = cffi.FFI()
        self.ffi.cdef(declarations())
        self.lib: Any = self.ffi.dlopen(str(path))


def built(folder: Path) -> Library:
    """Return the library, built into `folder` unless the environment names one."""
    given = os.environ.get("MOTORD_FIRMWARE_BUILD")
    if given:
        return Library(Path(given) / "libbridge.so")
    return Library(compile_library(folder / "libbridge.so", "-O1", "-g"))
