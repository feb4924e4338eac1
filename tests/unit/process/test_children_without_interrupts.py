"""Ctrl-C goes to all processes of a terminal: the daemon's children do not die of it."""

import sys

import pytest

from motord.recorder.launch import spawn_piped
from motord.service.host.children import spawn

INTERRUPTED = "import os, signal; os.kill(os.getpid(), signal.SIGINT)"


@pytest.mark.parametrize("start", [spawn, spawn_piped])
def test_a_child_that_is_interrupted_at_its_start_goes_on(start):
    with start([sys.executable, "-c", INTERRUPTED]) as child:
        child.communicate()
    assert child.returncode == 0
