"""Why a loop ended, as far as it can be known."""

from pathlib import Path
from typing import Any, cast

import pytest

from motord.loop.status import LoopPhase, LoopStatus
from motord.service.host.children import Ended, Process
from motord.service.host.loop_link import LoopLink
from motord.shm.run_directory import RunDir

NOBODY: Any = None
KILLED = Ended(cast(Process, NOBODY), "killed by SIGKILL", None)


@pytest.fixture
def run_dir(tmp_path: Path) -> RunDir:
    run_dir = RunDir("bench", tmp_path)
    run_dir.create()
    return run_dir


def test_without_its_status_the_exit_remains(run_dir: RunDir) -> None:
    assert LoopLink(NOBODY, run_dir).ended(KILLED) == "the loop ended: killed by SIGKILL"


def test_its_status_says_more(run_dir: RunDir) -> None:
    LoopStatus(phase=LoopPhase.FAILED, pid=1, error="no board").write(run_dir.loop_status)
    assert LoopLink(NOBODY, run_dir).ended(KILLED) == "the loop ended: no board"


def test_a_folder_that_was_removed_is_named_with_what_to_do(run_dir: RunDir) -> None:
    run_dir.path.rmdir()
    why = LoopLink(NOBODY, run_dir).ended(KILLED)
    assert why.startswith(f"the loop ended: killed by SIGKILL; {run_dir.path} was removed")
    assert why.endswith("end the daemon and start it again")
