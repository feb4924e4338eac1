"""The simulated bench of `motord demo` and `motord reproduce`: another rig in model and text."""

import tomllib
from dataclasses import replace
from unittest import mock

import pytest

from motord.config import ConfigError, packaged
from motord.experiments.subject import PhaseProgress, Recordings
from motord.identification import IdentifyError
from motord.reproduce import bench
from motord.reproduce.bench import with_rig
from motord.simulate import PlanSource

RIG = "nonlinear.rig.toml"


def test_another_rig_is_in_model_and_text() -> None:
    source = PlanSource.of()
    changed = with_rig(source, RIG)
    assert changed.config.bench.rig == packaged(RIG)
    assert changed.text == source.text.replace("report.rig.toml", RIG)


def test_a_bench_that_names_no_rig_gets_the_line_in_its_table() -> None:
    source = PlanSource.of()
    without = source.config.bench.model_copy(update={"rig": None})
    config = source.config.model_copy(update={"bench": without})
    text = source.text.replace('rig = "report.rig.toml"\n', "")
    changed = with_rig(replace(source, config=config, text=text), RIG)
    assert tomllib.loads(changed.text)["bench"]["rig"] == RIG
    assert tomllib.loads(changed.text)["bench"]["name"] == "sim"


def test_a_text_without_a_bench_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"no table \[bench\]"):
        with_rig(replace(PlanSource.of(), text="[loop]\nrate_Hz = 1000\n"), RIG)


def test_the_progress_of_identification_goes_on_while_a_run_is_read_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class ReadsTwice:
        @classmethod
        def of_runs(cls, runs: object, subject: object, progress: PhaseProgress) -> "ReadsTwice":
            for phase in ("reading", "reading again for order 6"):
                for part in (0.5, 1.0):
                    progress(phase, part)
            raise IdentifyError("enough")

    monkeypatch.setattr(bench, "Calibrator", ReadsTwice)
    seen: list[float] = []
    simulated = bench.SimulatedBench(PlanSource.of(), mock.Mock(), 1)
    with pytest.raises(IdentifyError):
        simulated.calibrate(Recordings(()), seen.append)
    assert seen == pytest.approx([0.45, 0.9, 0.675, 0.9])
