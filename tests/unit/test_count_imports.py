"""tools/count_imports.py: the path of a set-point is as it says, and no longer than it may be."""

import sys

from motord.config import load
from tests.docs.blocks import ROOT
from tests.support.short_recordings import ShortRecording

sys.path.insert(0, str(ROOT / "tools"))

import count_imports
from count_imports import FILES_MAX, PATH, Step


def test_the_path_of_a_set_point_is_the_one_listed():
    assert count_imports.path_errors() == []
    assert len({step.file for step in PATH}) <= FILES_MAX


def test_what_is_not_there_or_not_imported_is_found():
    path = (*PATH[:1], Step("control/step.py", "step", ""), Step("api/errors.py", "nothing", ""))
    assert count_imports.path_errors(path) == [
        "control/step.py: not imported by a file before it",
        "api/errors.py: no function nothing",
        "api/errors.py: not imported by a file before it",
    ]


def test_the_modules_of_an_analysis_are_counted_though_its_command_ends_the_process(tmp_path):
    recording = ShortRecording.of(load(), turns=5).write(tmp_path / "turns.mcap")
    modules = count_imports.imported_modules("cogging", [str(recording)])
    assert "motord.experiments.cogging.estimate" in modules
    assert not [m for m in modules if m.startswith(count_imports.ESTIMATOR)]
