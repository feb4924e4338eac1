"""What the tools say of the source: cppcheck, stack, what it needs of a C library, its size."""

from pathlib import Path

import pytest

from tests.firmware import stack
from tests.firmware.library import FIRMWARE, needs, run

STACK_BYTES_MAX = 400
TEXT_BYTES_MAX = 6144
BRIDGE_BYTES_MAX = 3584


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Path]]:
    folder = tmp_path_factory.mktemp("cortex-m4")
    return folder, stack.compile_for_the_board(folder)


def test_the_makefile_builds_the_host_library(tmp_path: Path) -> None:
    needs("gcc", "gcc")
    run("make", "-C", FIRMWARE, f"BUILD={tmp_path}", "host")
    assert (tmp_path / "libbridge.so").exists()


def test_cppcheck_finds_nothing() -> None:
    needs("cppcheck", "cppcheck")
    run("make", "-C", FIRMWARE, "cppcheck")


def test_the_stack_is_bounded_and_nothing_recurses(compiled: tuple[Path, list[Path]]) -> None:
    depths = stack.depths(compiled[0])
    assert set(depths) == set(stack.ENTRIES)
    assert all(32 < depth <= STACK_BYTES_MAX for depth in depths.values()), depths


def test_only_memory_functions_are_needed_of_a_library(
    compiled: tuple[Path, list[Path]],
) -> None:
    """No heap, no input and output, no strings."""
    _, objects = compiled
    defined, needed = set(), set()
    for line in run(needs("arm-none-eabi-nm", "binutils-arm-none-eabi"), *objects).stdout.split(
        "\n"
    ):
        fields = line.split()
        if len(fields) == 3:
            defined.add(fields[2])
        elif len(fields) == 2:
            needed.add(fields[1])
    outside = {name for name in needed - defined if not name.startswith("__aeabi_")}
    assert outside <= {"memcpy", "memset"}


def test_it_is_small(compiled: tuple[Path, list[Path]]) -> None:
    _, objects = compiled
    size = needs("arm-none-eabi-size", "binutils-arm-none-eabi")
    *_, total = run(size, "-t", *objects).stdout.strip().split("\n")
    text, data, bss = (int(field) for field in total.split()[:3])
    assert 1000 < text <= TEXT_BYTES_MAX
    assert (data, bss) == (0, 0)  # all state is in the board's one struct bridge


def test_the_state_is_small(library) -> None:
    assert library.ffi.sizeof("struct bridge") <= BRIDGE_BYTES_MAX
