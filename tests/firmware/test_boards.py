"""The images for the boards: that they build without a warning, their size and their stack."""

import struct
import subprocess
import sys

import pytest

from tests.firmware.call_depth import CallGraph
from tests.firmware.images import FIRMWARE, boards, need

IMAGES = ("stm32f405", "stm32f405_can", "qemu")
FLASH_MAX_BYTES = 16_384
RAM_MAX_BYTES = 32_768
"""Of 1 MB and of 128 KB."""
STACK_BYTES = 4096  # in stm32f405.ld
EXCEPTION_BYTES = 36
"""What the processor puts on the stack for an interrupt, without floating point."""
BOARD = "boards/stm32f405/board.c:"
OWN = ("self_test", "set_enable_line", "feed_watchdog", "read")
POINTED_TO = (*(f"{BOARD}{name}" for name in OWN), "timing_set_rate", "port_send")


def tool(name, *arguments):
    return subprocess.run(
        [f"arm-none-eabi-{name}", *map(str, arguments)], capture_output=True, text=True, check=True
    ).stdout


def symbols(image):
    """Return the symbols of an image with their addresses."""
    lines = tool("nm", image).splitlines()
    return {line.split()[-1]: int(line.split()[0], 16) for line in lines if len(line.split()) == 3}


@pytest.mark.parametrize("name", IMAGES)
def test_size(name):
    text, data, bss = map(int, tool("size", boards() / f"{name}.elf").splitlines()[1].split()[:3])
    sys.stdout.write(f"{name}: {text + data} bytes of flash, {data + bss} of RAM\n")
    assert 4096 < text + data < FLASH_MAX_BYTES
    assert STACK_BYTES < data + bss < RAM_MAX_BYTES
    assert (boards() / f"{name}.bin").stat().st_size == text + data


@pytest.mark.parametrize("name", IMAGES)
def test_the_image_begins_with_stack_and_reset(name):
    found = symbols(boards() / f"{name}.elf")
    vectors = struct.unpack("<98I", (boards() / f"{name}.bin").read_bytes()[: 98 * 4])
    assert vectors[0] == found["stack_top"] == 0x2000_0000 + STACK_BYTES
    assert vectors[1] == found["reset_handler"] | 1
    assert all(vector & 1 and 0x0800_0000 < vector < 0x0801_0000 for vector in vectors[1:])
    fault = found["fault_handler"] | 1
    assert vectors[2:7] == (fault,) * 5
    taken = {place for place, vector in enumerate(vectors) if vector != fault} - {0, 1}
    link = {16 + 19, 16 + 20} if name.endswith("_can") else {16 + 37}
    feed = {16 + 38} if name == "qemu" else set()
    assert taken == {14, 15} | link | feed


@pytest.mark.parametrize("name", IMAGES)
def test_no_heap_and_little_of_the_library(name):
    found = symbols(boards() / f"{name}.elf")
    assert not {"malloc", "_malloc_r", "_sbrk", "printf", "__aeabi_dadd"} & found.keys()


def test_static_analysis():
    need("cppcheck")
    done = subprocess.run(
        ["cppcheck", "--std=c11", "--enable=warning,style,performance,portability",
         "--inline-suppr", "--error-exitcode=1", "--quiet", "-I.", "-Iboards/stm32f405", "boards"],
        cwd=FIRMWARE, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_stack_suffices():
    graph = CallGraph(boards(), POINTED_TO)
    assert graph.kinds == {"static"}  # nothing whose size depends on data
    assert set(POINTED_TO) <= graph.stack_bytes.keys()
    depths = {
        name: graph.depth(name)
        for name in ("reset_handler", "systick_handler", "pendsv_handler", "usart1_handler",
                     "can1_rx0_handler", "can1_tx_handler")
    }  # fmt: skip
    moving_bytes = max(depths["usart1_handler"], depths["can1_rx0_handler"])
    bridge = max(depths["systick_handler"], depths["pendsv_handler"])
    deepest = depths["reset_handler"] + bridge + moving_bytes + 2 * EXCEPTION_BYTES
    sys.stdout.write(f"stack: {deepest} of {STACK_BYTES} bytes at most; {depths}\n")
    assert 500 < deepest < STACK_BYTES // 2
