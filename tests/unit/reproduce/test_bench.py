"""The simulated bench of `motord demo` and `motord reproduce`: another rig in model and text."""

import tomllib
from dataclasses import replace

import pytest

from motord.config import ConfigError, packaged
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
    bench = source.config.bench.model_copy(update={"rig": None})
    config = source.config.model_copy(update={"bench": bench})
    text = source.text.replace('rig = "report.rig.toml"\n', "")
    changed = with_rig(replace(source, config=config, text=text), RIG)
    assert tomllib.loads(changed.text)["bench"]["rig"] == RIG
    assert tomllib.loads(changed.text)["bench"]["name"] == "sim"


def test_a_text_without_a_bench_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"no table \[bench\]"):
        with_rig(replace(PlanSource.of(), text="[loop]\nrate_Hz = 1000\n"), RIG)
