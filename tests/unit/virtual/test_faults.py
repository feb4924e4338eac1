"""Faults in virtual time: the matrix of docs/faults.md, random timelines, timelines themselves."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from motord.config import Config, ConfigError, load
from motord.config.faults import KINDS, Fault, Timeline, load_timeline
from motord.config.timing import LATE_MAX_S, RATE_MAX_HZ
from motord.control.types import COMMAND, SETPOINT
from motord.rig.types import RIG_INPUT
from motord.schema import FAULT_COUNT_SHIFT, Flag, Request, State, Trip
from motord.virtual.bench import VirtualBench
from motord.virtual.faults import deliver_command, new_link
from tests.campaigns import faults as campaign
from tests.campaigns.fault_bench import STATES, Driver, outcome
from tests.campaigns.fault_table import TABLE, Row
from tests.support.random_faults import random_timeline

EXAMPLES = Path(__file__).parents[3] / "config" / "faults"
VIRTUAL = [kind for kind, known in KINDS.items() if "virtual" in known.places]


def setpoint() -> np.ndarray:
    wanted = np.zeros(1, SETPOINT)
    wanted["plan_point"] = -1
    return wanted


@pytest.mark.parametrize("row", TABLE, ids=lambda row: row.name)
def test_matrix(row: Row) -> None:
    for state in STATES:
        assert not campaign.wrong(row, state, outcome(row.fault, state)), state


def test_every_kind_that_can_be_had_here_is_in_the_matrix() -> None:
    assert {row.fault.kind for row in TABLE} == set(VIRTUAL)


def test_document_follows_from_the_tables() -> None:
    text = campaign.DOCUMENT.read_text()
    static, mark, measured = text.partition(campaign.MARK)
    assert mark, "run python -m tests.campaigns.faults --write"
    assert static.rstrip() == campaign.static_part().rstrip()
    assert all(row.name in measured for row in TABLE)


@pytest.mark.parametrize("seed", range(1, 13))
def test_random_timelines_end_off_or_in_a_trip(seed: int) -> None:
    _, faults, _, _ = campaign.random_run(seed)
    assert not faults


def test_samples_come_as_late_as_a_fault_says_also_in_the_fastest_loop() -> None:
    config = load()
    loop = config.loop.model_copy(update={"rate_Hz": RATE_MAX_HZ})
    bench = VirtualBench(config.model_copy(update={"loop": loop}))
    bench.inject(Fault(kind="bridge_late", delay_s=LATE_MAX_S, for_s=2.0))
    ticks, _ = bench.run(setpoint(), round(1.5 * RATE_MAX_HZ))
    assert ticks["sample_age_ns"][-1] == round(1e9 * LATE_MAX_S)


@pytest.mark.parametrize("also", [None, "phase_open", "current_stuck"])
@pytest.mark.parametrize(("brake", "torque_Nm"), [(0.643, 3.0), (0.643, 5.0), (0.5, 4.0)])
def test_late_feedback_of_a_turning_rotor_trips_only_if_it_is_wrong(
    brake: float, torque_Nm: float, also: str | None
) -> None:
    """15 of the 20 ms that feedback may be late, at 0.7 to 1.6 turns a second."""
    driver = Driver()
    driver.set(brake=brake)
    driver.run(1.0)
    driver.ask(Request.ENABLE)
    driver.run(0.05)
    driver.set(torque_Nm=torque_Nm)
    driver.run(2.5)
    driver.bench.inject(Fault(kind="can_late", delay_s=0.015, for_s=1.0))
    assert driver.run(0.1).state == State.ENABLED
    if also is not None:
        driver.bench.inject(Fault(kind=also, for_s=0.5))
    last = driver.run(0.8)
    assert last.i_age_ns == 15_000_000
    assert last.first_trip == (Trip.CURRENT_IMPLAUSIBLE if also else 0)
    if also is not None:
        tripped = driver.ticks[-1]["state"] == State.TRIPPED
        assert tripped.argmax() < 215  # ms: as early as with fresh feedback, and 15 later


def test_what_is_wrong_is_reported() -> None:
    """The checks of the matrix can fail: another row's outcome does not pass."""
    rows = {row.fault.kind: row for row in TABLE}
    found = outcome(Fault(kind="inverter_hot"), "torque")
    assert campaign.wrong(rows["bus_voltage"], "torque", found) == ["first cause TEMPERATURE"]
    [problem] = campaign.wrong(rows["brake_silent"], "torque", found)
    assert problem == "tripped: TEMPERATURE"
    quiet = outcome(Fault(kind="brake_silent", for_s=0.01), "idle")
    assert "not detected" in campaign.wrong(rows["inverter_hot"], "idle", quiet)


def test_without_faults_a_timeline_changes_nothing() -> None:
    """Bit for bit: wires that lose nothing are no wires at all."""
    blocks = []
    for faults in (None, Timeline(fault=(Fault(kind="inverter_hot", at_s=9.0),))):
        bench = VirtualBench(load(), seed=7, faults=faults)
        blocks.append(bench.run(setpoint(), 500))
    for plain, with_timeline in zip(*blocks, strict=True):
        for name in plain.dtype.names:
            np.testing.assert_array_equal(plain[name], with_timeline[name])


def test_the_recording_counts_the_faults_and_the_bench_reports_them() -> None:
    faults = Timeline(
        fault=(
            Fault(kind="host_stall", at_s=0.2, for_s=0.03),
            Fault(kind="inverter_hot", at_s=0.1, for_s=0.01),
        )
    )
    bench = VirtualBench(load(), faults=faults)
    ticks, _ = bench.run(setpoint(), 400)
    begun = ticks["bridge_status"] >> FAULT_COUNT_SHIFT
    assert [int(ticks["tick"][begun == n][0]) for n in (0, 1, 2)] == [0, 100, 230]
    assert [(e["kind"], e["tick"]) for e in bench.fault_events] == [
        ("inverter_hot", 100), ("host_stall", 200),
    ]  # fmt: skip
    [gap] = np.flatnonzero(ticks["flags"] & Flag.AFTER_GAP)
    assert ticks["missed"][gap - 1] == 0
    assert ticks["missed"][gap] == 30
    assert (ticks["temperature_C"][101:111] == 120.0).all()


def test_a_repeated_run_gives_the_same_bits() -> None:
    def run() -> np.ndarray:
        driver = Driver(seed=3)
        for fault in random_timeline(11, 1.0, "virtual", kinds=("can_drop", "current_noise")).fault:
            driver.bench.inject(fault)
        driver.bring_to("OFF")
        return driver.ticks[-1]

    assert run().tobytes() == run().tobytes()


@pytest.mark.kernel
@pytest.mark.parametrize("silent", [False, True])
def test_a_board_that_starts_anew_holds_the_line_open_until_asked_to(silent: bool) -> None:
    """Heartbeats of a host that has not noticed do not close it; nor does it report their loss."""
    link, command, rig_input = (
        new_link(1, 0.1, 0.005, 1000),
        np.zeros(1, COMMAND),
        np.zeros(1, RIG_INPUT),
    )

    def lines(enable: int, ticks: int = 1) -> set[int]:
        command["enable"] = enable
        seen = set()
        for _ in range(ticks):
            deliver_command(link, command, rig_input)
            seen.add(int(rig_input["enable_line"][0]))
        return seen

    assert (lines(0), lines(1, 20)) == ({0}, {1})
    link["board_down"] = 1
    assert lines(1, 2) == {0}
    link["board_down"], link["bridge_drop"] = 0, float(silent)
    assert lines(1, 20) == {0}
    assert link["beat_lost"] == 0
    link["bridge_drop"] = 0.0
    assert (lines(1), lines(0), lines(1)) == ({0}, {0}, {1})


@pytest.mark.parametrize("connection", ["star", "independent"])
@pytest.mark.kernel
def test_faults_of_the_rig_with_either_connection(connection: str) -> None:
    """All the rig's faults at once, in turn: finite, and never above the drive's limit."""
    data = load().model_dump()
    data["motor"]["connection"] = connection
    bench = VirtualBench(Config.model_validate(data), seed=2)
    truth_connection = bench.truth.model_dump()
    truth_connection["motor"]["connection"] = connection
    bench = VirtualBench(
        bench.config, truth=type(bench.truth).model_validate(truth_connection), seed=2
    )
    driver = Driver()
    driver.bench = bench
    driver.set(brake=0.6)
    driver.run(0.01)
    driver.ask(Request.ENABLE, torque_Nm=3.0)
    driver.run(0.03)
    for kind in VIRTUAL:
        bench.inject(Fault(kind=kind, for_s=0.004))
        if kind == "phase_open":
            bench.inject(Fault(kind=kind, for_s=0.004, phase="b"))
        driver.run(0.006)
        driver.ask(Request.RESET)
        driver.run(0.001)
        driver.ask(Request.ENABLE)
        driver.run(0.006)
    truth = np.concatenate(driver.truth)
    assert np.isfinite(truth["i_a_A"]).all()
    assert bench.fault_peak_A <= campaign.DRIVE_LIMIT_A
    assert len(bench.fault_events) == len(VIRTUAL) + 1
    if connection == "star":
        total = truth["i_a_A"] + truth["i_b_A"] + truth["i_c_A"]
        assert np.abs(total).max() < 1e-4


def test_an_open_phase_of_a_star_leaves_the_same_current_in_the_others() -> None:
    data = load().model_dump()
    data["motor"]["connection"] = "star"
    plain = VirtualBench(Config.model_validate(data), seed=2)
    truth = plain.truth.model_dump()
    truth["motor"]["connection"] = "star"
    driver = Driver()
    driver.bench = VirtualBench(plain.config, truth=type(plain.truth).model_validate(truth), seed=2)
    driver.bring_to("torque")
    driver.bench.inject(Fault(kind="phase_open", phase="b", for_s=0.02))
    driver.run(0.002)
    driver.run(0.015)
    rows = driver.truth[-1]
    assert np.abs(rows["i_a_A"]).max() > 1.0
    np.testing.assert_allclose(rows["i_a_A"], -rows["i_c_A"], atol=1e-5)
    assert not rows["i_b_A"].any()


def test_timelines_are_sorted_and_their_parameters_checked() -> None:
    timeline = Timeline.model_validate(
        {"fault": [{"kind": "can_drop", "at_s": 2.0}, {"kind": "phase_open", "phase": "c"}]}
    )
    assert [fault.kind for fault in timeline.fault] == ["phase_open", "can_drop"]
    assert timeline.fault[1].fraction == 1.0
    assert timeline.fault[1].end_s == pytest.approx(2.3)
    assert "fraction 1.0" in timeline.fault[1].summary()


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"kind": "gremlins"}, "no kind of fault; known: inverter_fault"),
        ({"kind": "can_drop", "phase": "a"}, "can_drop has no parameter phase; it has: fraction"),
        ({"kind": "inverter_off", "bit": 1}, "inverter_off has no parameter bit; it has: none"),
        ({"kind": "can_drop", "fraction": 1.5}, "less than or equal to 1"),
        ({"kind": "can_drop", "at_s": -1}, "greater than or equal to 0"),
        ({"kind": "can_drop", "until_s": 1}, "Extra inputs"),
    ],
)
def test_faults_that_cannot_be(wrong: dict[str, Any], says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        Fault.model_validate(wrong)


def test_a_fault_that_is_not_possible_here_is_refused() -> None:
    with pytest.raises(ConfigError, match="bridge_clock is not possible here, only in: emulate"):
        VirtualBench(load(), faults=Timeline(fault=(Fault(kind="bridge_clock"),)))
    with pytest.raises(ValueError, match="not possible"):
        VirtualBench(load()).inject(Fault(kind="bridge_clock"))


def test_a_bench_file_names_its_timeline(tmp_path: Path) -> None:
    (tmp_path / "t.toml").write_text('[[fault]]\nkind = "inverter_hot"\nat_s = 0.01\n')
    data = load().model_dump()
    data["bench"]["faults"] = tmp_path / "t.toml"
    bench = VirtualBench(Config.model_validate(data))
    ticks, _ = bench.run(setpoint(), 100)
    assert ticks["temperature_C"].max() == 120.0
    assert ticks["state"][-1] == State.OFF


def test_a_broken_timeline_is_named_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "t.toml"
    path.write_text('[[fault]]\nkind = "can_drop"\nfractoin = 0.5\n')
    with pytest.raises(ConfigError, match=r"t\.toml.*unknown key"):
        load_timeline(path)
    path.write_text('[[fault]]\nkind = ["can_drop"]\n')
    with pytest.raises(ConfigError, match=r"t\.toml:2: fault\[0\]\.kind: .*valid string"):
        load_timeline(path)


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.stem)
def test_examples_are_valid(path: Path) -> None:
    assert load_timeline(path).fault


def test_random_timelines_are_seeded_and_possible() -> None:
    for seed in range(100):
        timeline = random_timeline(seed, 2.0, "emulate")
        timeline.check_place("emulate")
        assert timeline == random_timeline(seed, 2.0, "emulate")
    drawn = {f.kind for seed in range(300) for f in random_timeline(seed, 2.0, "virtual").fault}
    assert drawn == set(VIRTUAL)
