"""Several processes add to a store at once, and one of them is killed: nothing is lost or half."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from motord.results.store import ResultsStore
from tests.unit.results.made_up import fill, result

pytestmark = pytest.mark.system

EACH = 40

ADDS = """
import sys
from itertools import count
from pathlib import Path
from motord.results.store import ResultsStore
from tests.unit.results.made_up import result

store = ResultsStore(Path(sys.argv[1]))
store.make()
numbers = range(int(sys.argv[2]), int(sys.argv[3])) if len(sys.argv) > 3 else count()
print("ready", flush=True)
sys.stdin.read(1)
print(sum(store.add(result(n, (0.8, 0.9, 1.0))).new for n in numbers))
"""


def adder(folder: Path, *arguments: int) -> "subprocess.Popen[str]":
    """Return a process that is ready to add, and begins when its stdin is closed."""
    process = subprocess.Popen(
        [sys.executable, "-c", ADDS, str(folder), *map(str, arguments)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2],
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


def test_two_processes_add_at_once_while_a_third_reads(tmp_path: Path) -> None:
    """Half of what each adds is also added by the other."""
    folder = tmp_path / "store"
    first, second = adder(folder, 0, EACH), adder(folder, EACH // 2, EACH + EACH // 2)
    for process in (first, second):
        assert process.stdin is not None
        process.stdin.close()
    seen = 0
    while first.poll() is None or second.poll() is None:
        contents = ResultsStore(folder).read()
        assert contents.unreadable == ()
        assert contents.table.num_rows % 3 == 0
        assert contents.table.num_rows >= seen
        seen = contents.table.num_rows
    for process in (first, second):
        with process:
            assert process.returncode == 0
    names = {path.name for path in folder.iterdir()}
    assert names == {result(n, (0.8, 0.9, 1.0)).file_name for n in range(EACH + EACH // 2)}
    table = ResultsStore(folder).read().table
    assert table.num_rows == 3 * len(names)


def test_a_process_that_is_killed_leaves_whole_results_alone(tmp_path: Path) -> None:
    folder = tmp_path / "store"
    process = adder(folder)
    assert process.stdin is not None
    process.stdin.close()
    while len(list(folder.glob("*.parquet"))) < 10:
        assert process.poll() is None
    process.send_signal(signal.SIGKILL)
    with process:
        process.wait()
    contents = ResultsStore(folder).read()
    assert contents.unreadable == ()
    assert contents.table.num_rows == 3 * len(list(folder.glob("*.parquet")))
    assert fill(folder, 0.8).read().unreadable == ()
