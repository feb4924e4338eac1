"""An event for each fault in the recording."""

from pathlib import Path
from typing import Any

import numpy as np

from motord.config import Config, load
from motord.schema import FAULT_COUNT_SHIFT, TICK_DTYPE
from motord.service.bench.injected_faults import InjectedFaults
from motord.service.host.events import EventLog
from tests.unit.emulate.benches import EMULATED


def block(*counts: int) -> np.ndarray:
    ticks = np.zeros(len(counts), TICK_DTYPE)
    ticks["bridge_status"] = np.array(counts, np.uint32) << FAULT_COUNT_SHIFT | 1
    ticks["t_ns"] = np.arange(len(counts)) + 1000
    return ticks


def made(config: Config) -> tuple[InjectedFaults, EventLog]:
    events = EventLog(lambda: 0)
    return InjectedFaults(config, events), events


def numbers_and_times(events: EventLog) -> list[Any]:
    return [(event.data["number"], event.t_ns) for event in events.recent()]


def test_of_a_simulated_bench_it_is_known_which(tmp_path: Path) -> None:
    (tmp_path / "t.toml").write_text(
        '[[fault]]\nkind = "inverter_hot"\nat_s = 2\n[[fault]]\nkind = "phase_open"\nat_s = 1\n'
    )
    data = load().model_dump()
    data["bench"]["faults"] = tmp_path / "t.toml"
    injected, events = made(Config.model_validate(data))
    injected.update(block(0, 0, 1, 1))
    injected.update(block(1, 2))
    injected.update(block(2, 2))
    assert [event.data["fault"]["kind"] for event in events.recent()] == [
        "phase_open", "inverter_hot",
    ]  # fmt: skip
    assert numbers_and_times(events) == [(1, 1002), (2, 1001)]
    assert "phase_open for 0.5 s, phase a" in events.recent()[0].message
    injected.update(block(0, 1))  # the loop was started again
    assert events.recent()[-1].data["fault"]["kind"] == "phase_open"


def test_of_an_emulator_those_count_that_come() -> None:
    injected, events = made(load(EMULATED))
    injected.update(block())
    injected.update(block(5, 5))
    assert numbers_and_times(events) == []
    injected.update(block(5, 7))
    assert [number for number, _ in numbers_and_times(events)] == [6, 7]
    injected.update(block(1))
    assert [number for number, _ in numbers_and_times(events)] == [6, 7, 1]


def test_the_count_wraps() -> None:
    injected, events = made(load())
    for count in range(1, 300):
        injected.update(block(count % 128))
    assert [number for number, _ in numbers_and_times(events)] == list(range(1, 300))
