"""What a bench cannot do is refused before anything moves: row, value, limit, what to do."""

import shutil
from collections import namedtuple
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.config import load
from motord.control import parameters
from motord.control.interlocks import update_i2t
from motord.control.step import new_memory
from motord.control.types import FEEDBACK
from motord.experiments.plans import build
from motord.experiments.profile import checks
from motord.experiments.profile.checks import HEAT_STEP_S, heated
from motord.experiments.profile.course import STEP_S, Course
from motord.experiments.profile.trace import read
from motord.sequencing import PlanError
from motord.sequencing.brake_servo import brake_torque_Nm
from motord.sequencing.continuous import fastest_Hz
from tests.unit.experiments.profile.profiles import SMALL, changed, made, write

FASTEST_Hz = fastest_Hz(load())
HOW_TO = Path(__file__).parents[4] / "docs" / "how-to" / "play-a-profile.md"


def test_the_example_can_be_played_and_says_what_it_is() -> None:
    plan = build("profile", load())
    assert len(plan.points) == 3
    assert plan.points[0].aim.startswith("cycle 1 of 3, 48 s of package:examples/profiles/short")
    assert plan.outlook.startswith("16 rows, sha256 ")
    assert plan.outlook.endswith("..., 1452 J of mechanical energy")
    assert plan.settings["sha256"] == build("profile", load(), plan.settings).settings["sha256"]
    assert 3 * 49 < plan.seconds < 3 * 53


@pytest.mark.parametrize(
    ("rows", "settings", "expected"),
    [
        ([(0, 0, 0), (1, 6.1, 1)], {}, ":3: 6.1 Nm is above [limits] torque_Nm = 6; lower it"),
        ([(0, 0, 0), (1, -6.1, -1)], {}, ":3: -6.1 Nm is above [limits] torque_Nm = 6"),
        (SMALL, {"torque_factor": 3.01}, ":3: 6.02 Nm is above"),
        ([(0, 0, 0), (9, 2, 1.7)], {}, ":3: 1.7 Hz is above 1.63 Hz, up to which the brake holds"),
        (SMALL, {"speed_factor": 3}, ":3: 2.4 Hz is above"),
        ([(0, 0, 0), (1, 1, 1), (1.25, 4, 1)], {}, ":4: the torque changes by 3 Nm within 0.25 s"),
        (SMALL, {"power_max_W": 10.0}, ":3: 10.05 W is above power_max_W = 10; lower torque or"),
        (
            [(0, 0, 0), (1, 1, 1), (1.2, 2, 0.5), (2, 1.5, 0.5)],
            {"power_max_W": 6.8}, ":3: 6.8",
        ),
        (
            [(0, 0, 0), (2, 4, 0.3), (4, 4, 0.3)], {},
            ":3: the brake holds at most 3.46 Nm at 0.3 Hz ([brake] torque_max_Nm",
        ),
        ([(0, 0, 0), (1, 0, 0), (2, 1, 0)], {}, ":4: the brake holds at most 0 Nm at 0 Hz"),
        ([(0, 0, 0), (1, 1, 1), (2, -1, 1)], {}, ":4: -1 Nm at 1 Hz lacks 1 Nm for this change"),
        ([(0, 0, 0), (1, 0, 1)], {"inertia_kg_m2": 0.1}, ":2: 0 Nm at 0 Hz lacks 0.628 Nm"),
        ([(0, 0, 0), (1, 0, 1)], {}, ""),
    ],
)  # fmt: skip
def test_what_the_limits_refuse(
    tmp_path: Path, rows: Any, settings: dict[str, Any], expected: str
) -> None:
    if not expected:
        made(tmp_path / "p.csv", rows, **settings)
        return
    with pytest.raises(PlanError) as error:
        made(tmp_path / "p.csv", rows, **settings)
    assert expected in str(error.value)
    assert str(error.value).startswith(f"profile: {tmp_path}/p.csv:")


@pytest.mark.parametrize(
    ("allowed", "refused"),
    [
        ([(0, 0, 0), (2, 6, 1)], [(0, 0, 0), (2, 6.001, 1)]),
        ([(0, 0, 0), (4, 2, FASTEST_Hz)], [(0, 0, 0), (4, 2, FASTEST_Hz * 1.001)]),
        ([(0, 0, 0), (1, 1, 1), (1.3, 4, 1)], [(0, 0, 0), (1, 1, 1), (1.2999, 4, 1)]),
        ([(0, 0, 0), (2, 3.57, 0.3), (3, 3.57, 0.3)], [(0, 0, 0), (2, 3.59, 0.3), (3, 3.59, 0.3)]),
    ],
)  # fmt: skip
def test_the_edge_of_each_limit(tmp_path: Path, allowed: Any, refused: Any) -> None:
    brake = load().brake
    assert brake_torque_Nm(brake, 1.0, 2 * np.pi * 0.3) == pytest.approx(3.4648, abs=1e-4)
    made(tmp_path / "p.csv", allowed)
    with pytest.raises(PlanError):
        made(tmp_path / "p.csv", refused)


QUICK = {"torque_rate_Nm_per_s": 200.0, "trip_torque_Nm": 9.0}
REVERSED = [(0, 0, 0.3), (1, 4.4, 0.6), (9, 4.4, 0.6), (9.1, 0, 0), (9.2, -4.4, -0.6), (12, 0, 0)]


def test_a_reversal_that_the_high_pass_shows_as_too_much_is_refused(tmp_path: Path) -> None:
    """From 4.4 Nm, held for four time constants, to -4.4 Nm: it shows -8.5 Nm."""
    inertia = {"inertia_kg_m2": 0.001}
    played = changed(limits=QUICK | {"trip_torque_Nm": 9.8})
    made(tmp_path / "p.csv", REVERSED, played, **inertia)
    with pytest.raises(
        PlanError, match=r"p.csv:\d: at t = 9\.\d s the torque sensor would show mor"
    ):
        made(tmp_path / "p.csv", REVERSED, changed(limits=QUICK), **inertia)
    passes_mean = changed(limits=QUICK, torque_sensor={"highpass_time_constant_s": 0.0})
    made(tmp_path / "p.csv", REVERSED, passes_mean, **inertia)


def test_a_rotor_that_a_weak_brake_would_let_run_away_is_refused(tmp_path: Path) -> None:
    rows = [(0, 0, 0), (3, 1.3, FASTEST_Hz), (5, 1.3, FASTEST_Hz)]
    made(tmp_path / "p.csv", rows, changed(brake={"torque_max_Nm": 1.6}))
    rows = [(t, 1.39 / 1.3 * torque_Nm, speed_Hz) for t, torque_Nm, speed_Hz in rows]
    with pytest.raises(PlanError, match=r"p.csv:[34]: the rotor could reach 2\d.* rad/s at t = "):
        made(tmp_path / "p.csv", rows, changed(brake={"torque_max_Nm": 1.6}))


@given(
    ratios=st.lists(st.floats(0, 3), min_size=2, max_size=400),
    before_s=st.floats(0, 2),
    limit_s=st.floats(0.01, 3),
)
def test_i2t_is_that_of_the_kernel(ratios: list[float], before_s: float, limit_s: float) -> None:
    [p] = parameters.build(changed(limits={"i2t_current_A": 1.0, "i2t_time_s": limit_s}))[0]
    [m], [f] = new_memory(), np.zeros(1, FEEDBACK)
    m.heat_s[0] = before_s
    first = None
    for number, ratio in enumerate(ratios):
        f.i_A[0] = ratio
        update_i2t(p, m, f, HEAT_STEP_S)
        if m.heat_s[0] > limit_s:
            first = number
            break
    exact = np.float32(ratios).astype(float)
    found, end_s = heated(exact[:, None], np.array([before_s]), limit_s)
    assert found == first
    if first is None:
        assert end_s[0] == pytest.approx(m.heat_s[0], abs=1e-9)


def test_the_i2t_limit_is_found_with_time_and_line(tmp_path: Path) -> None:
    rows = [(0, 0, 0), (2, 5, 1), (60, 5, 1), (62, 0, 0)]
    hot = changed(limits={"i2t_current_A": 10.0, "i2t_time_s": 5.0})
    with pytest.raises(PlanError) as error:
        made(tmp_path / "p.csv", rows, hot)
    said = str(error.value)
    assert "p.csv:3: the i2t limit would be reached at t = " in said
    assert "([limits] i2t_current_A = 10, i2t_time_s = 5); lower the torque before" in said
    documented = " ".join(HOW_TO.read_text().split())
    assert said.replace(f"{tmp_path}/p.csv", "cycle.csv") in documented
    at_s = float(said.partition("t = ")[2].partition(" ")[0])
    peak_A = 5 / 0.206 / 1.5 * checks.CURRENT_MARGIN
    assert at_s == pytest.approx(5.0 / (peak_A**2 / 2 / 100 - 1) + 1.8, rel=0.1)
    made(tmp_path / "p.csv", rows)
    made(tmp_path / "p.csv", [(0, 0, 0), (2, 5, 1), (at_s - 1.5, 5, 1), (at_s, 0, 0)], hot)


def test_the_excitation_is_there_when_it_is_needed(tmp_path: Path) -> None:
    """Followed by the set-points, with the brake's time constant; a quick one, too."""
    rows = [(0, 0, 0), (2, 1, 1.0), (4, 1, 1.0), (4.4, 5, 1.0), (8, 5, 1.0), (8.4, 1, 1.0)]
    trace = read(str(write(tmp_path / "p.csv", rows)))
    for tau_s in (0.0, 0.01, 0.2, 2.0):
        config = changed(brake={"excitation_time_constant_s": tau_s})
        course = Course.of(trace, config, 0.01)
        assert course.begins_s == pytest.approx(-4 * tau_s, abs=0.051)
        excitation, short = course.brake[0], []
        for at_s, torque_Nm, setpoint in zip(
            course.at_s[:-1], course.torque_Nm[1:], course.brake[:-1], strict=True
        ):
            left = np.exp(-STEP_S / tau_s) if tau_s else 0.0
            excitation = setpoint + (excitation - setpoint) * left
            if 2.1 < at_s < 8:
                held_Nm = brake_torque_Nm(config.brake, excitation, 2 * np.pi)
                short.append(float(torque_Nm - held_Nm))
        assert 0 <= course.brake.min() <= course.brake.max() <= 1
        assert max(short) < 1e-6
        assert min(short) > (-1e-6 if tau_s < 0.1 else -4.1)


def test_heat_that_stays_from_cycle_to_cycle_counts(tmp_path: Path) -> None:
    rows = [(0, 0, 0), (1, 5, 1), (11, 5, 1), (12, 0, 0), (13, 0, 0)]
    warm = changed(limits={"i2t_current_A": 10.0, "i2t_time_s": 6.0})
    made(tmp_path / "p.csv", rows, warm)
    with pytest.raises(
        PlanError, match=r"the i2t limit would be reached at t = .* s of cycle [2-9]"
    ):
        made(tmp_path / "p.csv", rows, warm, repeats=50)


def test_compensated_currents_are_reckoned_with_more(tmp_path: Path) -> None:
    rows = [(0, 0, 0), (1, 5, 1), (60, 5, 1), (61, 0, 0)]
    limits = changed(limits={"i2t_current_A": 12.5, "i2t_time_s": 3.0})
    made(tmp_path / "p.csv", rows, limits)
    with pytest.raises(PlanError, match="i2t limit"):
        made(tmp_path / "p.csv", rows, limits, compensate="on")


def test_a_recording_must_fit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made(tmp_path / "p.csv", SMALL, repeats=100)
    with pytest.raises(
        PlanError, match=r"3\d\d s do not fit in one file, \[recording\] file_max_s"
    ):
        made(tmp_path / "p.csv", SMALL, changed(recording={"file_max_s": 300.0}), repeats=50)
    with pytest.raises(
        PlanError, match=r"MB do not fit in one file, \[recording\] file_max_MB = 1"
    ):
        made(tmp_path / "p.csv", SMALL, changed(recording={"file_max_MB": 1.0}))
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(0, 0, 501_000_000))
    with pytest.raises(PlanError, match=r"may take 1 MB, and .* has 1 MB beyond"):
        made(tmp_path / "p.csv", SMALL)


def test_room_in_a_folder_that_cannot_be_looked_at_is_not_judged(tmp_path: Path) -> None:
    """As in one that is another user's; it ended with a traceback."""
    beyond = tmp_path / ("x" * 300) / "recordings"  # an error that is not that there is none
    made(tmp_path / "p.csv", SMALL, changed(recording={"directory": str(beyond)}))
