"""Ctrl-C, and the end of a terminal, go to all processes of it: a daemon's children do not die."""

import sys

import pytest

from motord.recorder.launch import spawn_piped
from motord.service.host.children import spawn


@pytest.mark.parametrize("signal", ["SIGINT", "SIGHUP"])
@pytest.mark.parametrize("start", [spawn, spawn_piped])
def test_a_child_that_gets_it_at_its_start_goes_on(start, signal):
    sent = f"import os, signal; os.kill(os.getpid(), signal.{signal})"
    with start([sys.executable, "-c", sent]) as child:
        child.communicate()
    assert child.returncode == 0
