import platform
import subprocess
import sys

import pytest

PROGRAM = """
import ctypes, sys, threading
import psutil
from motord.process.allocator import return_free_memory, shrink_heaps_from_their_end

libc = ctypes.CDLL(None)
libc.malloc.restype, libc.malloc.argtypes = ctypes.c_void_p, [ctypes.c_size_t]
libc.free.argtypes = [ctypes.c_void_p]
shrink_heaps_from_their_end() if sys.argv[1] == "shrunk" else None
libc.free(libc.malloc(30_000_000))

def work():
    own, before = psutil.Process(), psutil.Process().memory_info().rss
    blocks = [libc.malloc(100_000) for _ in range(300)]
    for block in blocks:
        ctypes.memset(block, 1, 100_000)
    for block in blocks:
        libc.free(block)
    return_free_memory()
    print(own.memory_info().rss - before)

thread = threading.Thread(target=work)
thread.start()
thread.join()
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="of glibc alone")
@pytest.mark.parametrize("how", ["shrunk", "as it is"])
def test_a_thread_whose_heap_was_large_does_not_keep_it(how: str) -> None:
    """After a large block was freed, too; by itself the C library keeps all 30 MB."""
    command = [sys.executable, "-c", PROGRAM, how]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert (int(done.stdout) < 10_000_000) == (how == "shrunk")
