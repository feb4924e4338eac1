"""The bench file: what is right is read, what is wrong is named with file, line and key."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord import config
from motord.config import ConfigError, load
from motord.config.reading import load_motor

ROOT = Path(__file__).resolve().parents[3]

BENCH = """\
[bench]
name = "test"

[loop]
rate_Hz = 1000

[motor]
name = "m"
pole_pairs = 8
slots = 48
counts = 4096
rated_torque_Nm = 6.0
connection = "star"
back_emf = [{order = 1, amplitude_V_s_per_rad = 0.2}]

[limits]
current_A = 20.0
"""


SPEED = 'setpoint_kind = "i16"\nsetpoint_scale = 0.001\n'


def read(tmp_path: Path, text: str) -> config.Config:
    path = tmp_path / "bench.toml"
    path.write_text(text)
    return load(path)


def complaint(tmp_path: Path, text: str) -> str:
    with pytest.raises(ConfigError) as caught:
        read(tmp_path, text)
    message = str(caught.value)
    assert "\n" not in message
    assert "bench.toml" in message
    return message


def test_a_small_bench_is_enough(tmp_path: Path) -> None:
    bench = read(tmp_path, BENCH)
    assert bench.simulated
    assert bench.motor.connection == "star"
    assert bench.limits.current_A == 20.0
    assert bench.zenoh.listen == ("tcp/127.0.0.1:7447",)
    with pytest.raises(ValueError, match="frozen"):
        bench.bench.name = "other"


@pytest.mark.parametrize("path", sorted((ROOT / "config").glob("*.toml")), ids=lambda p: p.name)
def test_the_benches_that_ship_are_valid(path: Path) -> None:
    assert load(path).bench.name


def test_without_a_file_it_is_the_simulated_bench() -> None:
    assert load().simulated


@pytest.mark.parametrize(
    ("old", "new", "line", "expected"),
    [
        ("rate_Hz = 1000", "rate_hz = 1000", 5, "loop.rate_hz: unknown key; did you mean rate_Hz"),
        ("[limits]", "[limit]", 16, "limit: unknown key; did you mean limits"),
        ("[limits]", "[motor.limits]", 16, "motor.limits: unknown key; did you mean [limits]?"),
        ("rate_Hz = 1000", "bus_V_min = 9.0", 5, "bus_V_min: unknown key; it is a key of [limits]"),
        ("rate_Hz = 1000", "counts = 9", 5, "it is a key of [motor]; did you mean overrun_ticks?"),
        ("[limits]", "[modbus]\n[limits]", 16, "it is a key of [brake] and of [drive]"),
        ("rate_Hz = 1000", "rate_Hz = 50", 5, "greater than or equal to 100, got 50"),
        ("rate_Hz = 1000", 'rate_Hz = "fast"', 5, "loop.rate_Hz: "),
        ("current_A = 20.0", "current_A = -1.0", 17, "limits.current_A: "),
        ("current_A = 20.0", "current_A = nan", 17, "limits.current_A: "),
        ("current_A = 20.0", "current_A = 50.0", 16, "trip_current_A = 35 must be above"),
        ('connection = "star"', 'connection = "delta"', 13, "'star' or 'independent'"),
        ("slots = 48\n", "", 7, "motor.slots: missing"),
        ("order = 1", "order = 0", 14, "motor.back_emf"),
        ('name = "test"', 'name = "a b"', 2, "bench.name: "),
        ("[limits]", '[inverter]\ndriver = "can"\n[limits]', 16, "[inverter.can]"),
        ("[limits]", '[bridge]\ndriver = "serial"\n[limits]', 16, "needs port"),
        ("[limits]", '[brake]\ndriver = "modbus"\n[limits]', 16, "needs a table"),
        (
            "[limits]",
            "[torque_sensor]\ngain_Nm_per_V = -1.2\n[limits]",
            17,
            "exchange the amplifier's inputs, then align again, got -1.2",
        ),
        ("[limits]", "[limits]\nbus_V_min = 40.0", 16, "bus_V_max must be above"),
        (
            "[limits]",
            '[zenoh]\nlisten = "tcp/127.0.0.1:7447"\n[limits]',
            17,
            "takes a list, [...], got 'tcp/127.0.0.1:7447'",
        ),
        ("[limits]", "[channels]\nrate_Hz = 1.0\n[limits]", 16, "takes a list, [[channels]]"),
        ("[bench]", "brake = 3\n[bench]", 1, "brake: is a table, [brake], got 3"),
    ],
)
def test_what_is_wrong_is_named(
    tmp_path: Path, old: str, new: str, line: int, expected: str
) -> None:
    assert old in BENCH
    message = complaint(tmp_path, BENCH.replace(old, new))
    assert f"bench.toml:{line}: " in message, message
    assert expected in message, message


def test_two_mistakes_are_both_named(tmp_path: Path) -> None:
    text = BENCH.replace("rate_Hz = 1000", "rate_Hz = 1").replace("slots = 48", "slots = 0")
    with pytest.raises(ConfigError) as caught:
        read(tmp_path, text)
    first, second = caught.value.lines
    assert "loop.rate_Hz" in first
    assert "motor.slots" in second


def test_half_a_simulation_is_refused(tmp_path: Path) -> None:
    bridge = '[bridge]\ndriver = "serial"\nport = "/dev/ttyACM0"\n'
    assert "simulated together or not at all" in complaint(tmp_path, BENCH + bridge)


def test_a_heartbeat_timeout_that_no_board_takes_is_refused(tmp_path: Path) -> None:
    for wrong in ("0.0009", "1.001"):
        said = complaint(tmp_path, f"{BENCH}[bridge]\nheartbeat_timeout_s = {wrong}\n")
        assert "bridge.heartbeat_timeout_s" in said


@pytest.mark.parametrize(
    ("drive", "modbus", "loop", "expected"),
    [
        ("", "", "", "has no watchdog_s"),
        ("", "watchdog_s = 0.2", "", ""),
        ("", "watchdog_s = 0.201", "", "Together they may be 0.3 s"),
        ("", "watchdog_s = 0.2\ntimeout_s = 0.101", "", "timeout_s (0.101 s) are too long"),
        ("", "watchdog_s = 0.25\ntimeout_s = 0.05", "", ""),
        ("", "watchdog_s = 0.3", "supervisor_timeout_s = 0.02", "may be 0.38 s"),
        ("", "watchdog_s = 0.28", "supervisor_timeout_s = 0.02", ""),
        ("", "watchdog_s = 0.2", "supervisor_timeout_s = 1.0", ""),
        ("poll_s = 0.1", "watchdog_s = 0.2", "", ""),
        ("poll_s = 0.101", "watchdog_s = 0.2", "", "make it at most 0.1"),
    ],
)
def test_a_drive_that_would_go_on_without_the_daemon_is_refused(
    tmp_path: Path, drive: str, modbus: str, loop: str, expected: str
) -> None:
    text = BENCH.replace("[loop]\n", f"[loop]\n{loop}\n")
    text += f'[zenoh]\nlease_s = 5.0\n[drive]\ndriver = "modbus"\n{drive}\n'
    text += f"[drive.modbus]\n{SPEED}{modbus}\n"
    if expected:
        assert expected in complaint(tmp_path, text)
    else:
        read(tmp_path, text)


def test_a_brake_on_the_drives_line_counts(tmp_path: Path) -> None:
    line = 'transport = "rtu"\nserial_port = "/dev/ttyUSB0"\n'
    drive = (
        f'[drive]\ndriver = "modbus"\n[drive.modbus]\n{line}{SPEED}watchdog_s = 0.2\n'
        "timeout_s = 0.05\n"
    )
    brake = f'[brake]\ndriver = "modbus"\n[brake.modbus]\n{line}timeout_s = '
    read(tmp_path, f"{BENCH}{drive}{brake}0.05\n")
    assert "that of the brake on its line (0.11 s)" in complaint(
        tmp_path, f"{BENCH}{drive}{brake}0.06\n"
    )
    other = brake.replace("USB0", "USB1")
    read(tmp_path, f"{BENCH}{drive}{other}0.5\n")


@pytest.mark.parametrize(
    ("section", "line", "says"),
    [
        ("loop", "supervisor_timeout_s = 1.01", "loop.supervisor_timeout_s"),
        ("loop", "supervisor_timeout_s = 0.019", "loop.supervisor_timeout_s"),
        ("loop", "enable_timeout_s = 10.1", "loop.enable_timeout_s"),
        ("bench", "rig_patience_s = 0.0019", "the rig's time would stand still"),
        ("loop", "observer_bandwidth_Hz = 14.9", "loop.observer_bandwidth_Hz"),
        ("loop", "overrun_ticks = 1001", "stand still for 1.001 s"),
        ("inverter", "timeout_s = 1.01", "inverter.timeout_s"),
        ("inverter", "timeout_s = 0.0019", "commands come every 0.001 s"),
        ("inverter", "stale_after_s = 1.01", "inverter.stale_after_s"),
        ("inverter", "stale_after_s = 0.0019", "feedback comes every 0.001 s"),
        ("inverter", "feedback_age_s = 0.02", "[inverter] stale_after_s = 0.02 is too short"),
        (
            "inverter",
            "feedback_age_s = 0.02",
            "old (feedback_age_s): always stale; make it at least 0.022",
        ),
        ("inverter", "feedback_age_s = 0.019", "at least 0.021, or raise the rates"),
        ("inverter", "actuation_delay_s = 0.021", "inverter.actuation_delay_s"),
        ("bridge", "stale_after_s = 1.01", "bridge.stale_after_s"),
        ("bridge", "stale_after_s = 0.0019", "samples come every 0.001 s"),
        ("bridge", "rate_Hz = 100\nstale_after_s = 0.019", "samples come every 0.01 s"),
        ("bridge", "heartbeat_timeout_s = 0.0019", "heartbeats come every 0.001 s"),
        ("limits", "trip_torque_Nm = 6.0", "or every full torque would trip"),
        ("limits", "encoder_jump_rad = 1.6", "limits.encoder_jump_rad"),
        ("limits", "encoder_jump_rad = 0.0016", "make it at least 0.0157"),
        ("limits", "encoder_jump_rad = 0.0156", "make it at least 0.0157"),
        ("limits", "encoder_jump_rad = 0.0157\ntrip_speed_rad_s = 60", "make it at least 0.0219"),
        ("limits", "current_error_s = 0.00099", "make it at least 0.001"),
        ("limits", "torque_error_s = 0.0037", "make it at least 0.0038"),
        ("loop", "enable_timeout_s = 0.0219", "make it at least 0.022"),
        ("inverter", "feedback_age_s = 0.99\nstale_after_s = 1.0", "make it at least 1.02"),
        ("limits", "link_errors_per_s = 0.9", "limits.link_errors_per_s"),
        ("loop", "overrun_ticks = 1", "loop.overrun_ticks"),
        (
            "limits",
            "trip_speed_rad_s = 0.53",
            "at least 0.639, or lower [loop] observer",
        ),
        ("limits", "link_errors_per_s = 2001.0", "lets more frames be lost than the loop needs"),
        ("limits", "trip_speed_rad_s = 786.0", "make it at most 785"),
        ("limits", "current_error_s = 1.1", "limits.current_error_s"),
        ("limits", "torque_error_s = 1.1", "limits.torque_error_s"),
        ("limits", "current_error_A = 17.33", "a drive without any current"),
        ("limits", "torque_error_Nm = 4.8", "make it less than 4.8"),
        ("bridge", "adc_V_per_count = 1.81", "one count would be a torque error (torque_error_Nm)"),
        ("bridge", "adc_V_per_count = 1.81", "at most 1.8, or lower [torque_sensor] gain_Nm_per_V"),
        ("bridge", "adc_V_per_count = 5.58e-9", "no number of counts would reach trip_torque_Nm"),
        ("bridge", "adc_V_per_count = 5.58e-9", "at least 5.59e-09, or raise [torque_sensor] gain"),
        ("torque_sensor", "gain_Nm_per_V = 5900.0", "[torque_sensor] gain_Nm_per_V = 5900 is too"),
        ("torque_sensor", "gain_Nm_per_V = 5900.0", "make it at most 5890, or lower [bridge] adc"),
        ("limits", "torque_Nm = 0.001", "[limits] torque_Nm = 0.001 is too small: one count would"),
        ("limits", "torque_Nm = 0.001", "make it at least 0.00102, or measure finer"),
        ("limits", "torque_error_Nm = 1e-4\ntorque_error_s = 1.0", "[limits] torque_error_Nm = "),
    ],
)
def test_what_would_take_an_interlock_its_time_is_refused(tmp_path, section, line, says) -> None:
    table = f"[{section}]\n"
    text = BENCH.replace(table, table + line + "\n") if table in BENCH else BENCH + table + line
    assert says in complaint(tmp_path, text)


@pytest.mark.parametrize(
    ("section", "lines"),
    [
        ("limits", "encoder_jump_rad = 0.0157\ncurrent_error_s = 0.001\ntorque_error_s = 0.0038"),
        ("limits", "link_errors_per_s = 1.0"),
        ("limits", "link_errors_per_s = 2000.0"),
        ("loop", "enable_timeout_s = 0.022"),
        ("limits", "current_error_A = 17.32\ntorque_error_Nm = 4.79"),
        ("bridge", "adc_V_per_count = 1.8"),
        ("bridge", "adc_V_per_count = 5.59e-9"),
        ("torque_sensor", "gain_Nm_per_V = 5890.0"),
        ("limits", "torque_Nm = 0.00102"),
    ],
)
def test_the_bound_that_is_named_is_accepted(tmp_path: Path, section: str, lines: str) -> None:
    table = f"[{section}]\n"
    read(tmp_path, BENCH.replace(table, table + lines + "\n"))


def test_a_bound_of_many_digits_is_named_so_that_it_is_accepted(tmp_path: Path) -> None:
    text = BENCH.replace("rate_Hz = 1000", "rate_Hz = 300") + "[inverter]\ntimeout_s = "
    assert "make it at least 0.00667" in complaint(tmp_path, f"{text}0.0066666\n")
    read(tmp_path, f"{text}0.00667\n")


def test_a_bound_that_the_setting_does_not_reach_is_no_remedy(tmp_path: Path) -> None:
    slow = BENCH.replace("rate_Hz = 1000", "rate_Hz = 100") + "[inverter]\n"
    refused = complaint(tmp_path, f"{slow}feedback_age_s = 0.995\nstale_after_s = 0.999\n")
    assert "one may be lost; raise the rates" in refused


def test_the_greatest_number_of_ticks_is_named_exactly(tmp_path: Path) -> None:
    text = BENCH.replace("rate_Hz = 1000", "rate_Hz = 2345\noverrun_ticks = 2346")
    assert "make it at most 2345" in complaint(tmp_path, text)


@pytest.mark.parametrize("device", ["brake", "drive"])
@pytest.mark.parametrize("poll_s", ["0.6", "0.5000001", "5.0"])
def test_a_slow_device_is_read_twice_before_it_is_silent(
    tmp_path: Path, device: str, poll_s: str
) -> None:
    refused = complaint(tmp_path, f"{BENCH}[{device}]\npoll_s = {poll_s}\n")
    assert f"[{device}] stale_after_s = 1" in refused
    assert "make it at least" in refused
    if poll_s == "0.5000001":
        read(tmp_path, f"{BENCH}[{device}]\npoll_s = {poll_s}\nstale_after_s = 1.01\n")


def test_a_lost_answer_of_a_slow_device_is_no_silence(tmp_path: Path) -> None:
    brake = '[brake]\ndriver = "modbus"\nstale_after_s = {}\n[brake.modbus]\ntimeout_s = 0.5\n'
    assert "make it at least 0.6" in complaint(tmp_path, BENCH + brake.format(0.59))
    read(tmp_path, BENCH + brake.format(0.6))
    line = 'transport = "rtu"\nserial_port = "/dev/ttyUSB0"\n'
    drive = f'[drive]\ndriver = "modbus"\n[drive.modbus]\n{line}{SPEED}watchdog_s = 0.2\n'
    shared = f"{BENCH}{drive}timeout_s = 0.05\n"
    quick = f"{brake}{line}".replace("timeout_s = 0.5\n", "timeout_s = 0.05\n")
    assert "make it at least 0.2" in complaint(tmp_path, shared + quick.format(0.19))
    read(tmp_path, shared + quick.format(0.2))


def test_a_slow_drive_needs_longer_errors_of_the_torque(tmp_path: Path) -> None:
    slow = BENCH.replace("rate_Hz = 1000", "rate_Hz = 100") + (
        "torque_error_s = 0.0799\n[inverter]\nactuation_delay_s = 0.02\nlag_s = 0.01\n"
    )
    assert "[limits] torque_error_s = 0.0799 is too short" in complaint(tmp_path, slow)
    read(tmp_path, slow.replace("0.0799", "0.08"))


def test_a_bench_whose_encoder_always_seems_to_jump_is_refused(tmp_path: Path) -> None:
    """One count of an encoder of 16 is 0.39 rad: no jump that is legal would do."""
    coarse = BENCH.replace("counts = 4096", "counts = 16").replace("1000", "5000")
    coarse += "encoder_jump_rad = 1.57\ntrip_speed_rad_s = 3000.0\n"
    read(tmp_path, coarse.replace("[motor]", "observer_bandwidth_Hz = 80.0\n[motor]"))
    quick = coarse.replace("[motor]", "observer_bandwidth_Hz = 200.0\n[motor]")
    assert "lower observer_bandwidth_Hz or trip_speed_rad_s" in complaint(tmp_path, quick)


def test_a_speed_limit_too_fast_for_the_samples_is_refused(tmp_path: Path) -> None:
    slow = BENCH + "trip_speed_rad_s = 79.0\n[bridge]\nrate_Hz = 100\n"
    said = complaint(tmp_path, slow)
    assert "trip_speed_rad_s = 79 is too fast for 100 encoder samples a second" in said
    assert read(tmp_path, slow.replace("79.0", "78.0")).bridge.rate_Hz == 100


def test_a_lease_too_short_for_the_ramp_is_refused_with_what_it_needs(tmp_path: Path) -> None:
    slow = BENCH.replace("[loop]", "[loop]\nsupervisor_timeout_s = 1.0") + (
        "torque_rate_Nm_per_s = 2.0\n"
    )
    said = complaint(tmp_path, slow)
    assert "[zenoh] lease_s = 2 is too short" in said
    assert "takes 1 s" in said  # the way down is never longer, however gentle the way up
    assert "supervisor_timeout_s = 1 " in said
    assert said.endswith("make it at least 2.25")
    assert read(tmp_path, slow + "[zenoh]\nlease_s = 2.25\n").renew_within_s == pytest.approx(0.2)


def test_not_toml(tmp_path: Path) -> None:
    said = complaint(tmp_path, '[bench]\nname = bench 3\nnotes = ""\n')
    assert "not valid TOML: Invalid value (at line 2, column 8): name = bench 3; text is in" in said
    assert "not valid TOML" in complaint(tmp_path, "[bench\nname=3")


@pytest.mark.parametrize(
    ("line", "hint"),
    [
        ("rate_Hz = 1000,0  # of the loop", "a number has a decimal point, not a comma"),
        ("rate_Hz = -1,5", "a number has a decimal point, not a comma"),
        ("auto = yes", "it is true or false, in small letters"),
        ("auto = True", "it is true or false, in small letters"),
        ("name = north", 'text is in quotes, "..."'),
    ],
)
def test_what_is_usually_meant_by_what_is_not_toml(tmp_path: Path, line: str, hint: str) -> None:
    assert complaint(tmp_path, f"{line}\n").endswith(f": {line}; {hint}")


def test_not_text(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="not a text file"):
        load(path)


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"cannot read it: No such file.*; motord new writes"):
        load(tmp_path / "none.toml")


@given(st.binary(max_size=200))
def test_random_bytes_are_one_clear_line(data: bytes) -> None:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.toml"
        path.write_bytes(data)
        with pytest.raises(ConfigError) as caught:
            load(path)
        assert str(path) in str(caught.value)


def test_files_are_relative_to_the_bench(tmp_path: Path) -> None:
    rig = read(tmp_path, BENCH.replace('name = "test"', 'name = "test"\nrig = "a.toml"')).bench.rig
    assert rig == tmp_path / "a.toml"
    text = BENCH.replace('name = "test"', 'name = "test"\nrig = "package:report.rig.toml"')
    rig = read(tmp_path, text).bench.rig
    assert rig is not None
    assert rig.exists()


@given(
    pole_pairs=st.integers(1, 20),
    counts=st.integers(200, 5000),
    third=st.floats(0, 0.05),
)
def test_phases_are_the_same_wave_a_third_of_a_period_apart(
    pole_pairs: int, counts: int, third: float
) -> None:
    motor = config.MotorConfig.model_validate(
        {
            "name": "m",
            "pole_pairs": pole_pairs,
            "slots": 12,
            "counts": 3 * pole_pairs * (counts // (3 * pole_pairs) + 1),
            "rated_torque_Nm": 1.0,
            "connection": "star",
            "back_emf": [
                {"order": 1, "amplitude_V_s_per_rad": 0.2},
                {"order": 3, "amplitude_V_s_per_rad": third, "phase_rad": 0.4},
            ],
        }
    )
    k = motor.back_emf_table()
    shift = motor.counts // (3 * pole_pairs)
    assert np.roll(k[:, 0], shift) == pytest.approx(k[:, 1], abs=1e-9)
    assert np.roll(k[:, 0], 2 * shift) == pytest.approx(k[:, 2], abs=1e-9)


def test_encoder_offset_turns_the_table(tmp_path: Path) -> None:
    plain = read(tmp_path, BENCH).motor.back_emf_table()
    offset_rad = 2 * np.pi * 100 / 4096
    text = BENCH.replace("slots = 48", f"slots = 48\nencoder_offset_rad = {offset_rad!r}")
    turned = read(tmp_path, text).motor.back_emf_table()
    assert np.roll(plain, -100, axis=0) == pytest.approx(turned, abs=1e-9)


def test_back_emf_from_a_table_file(tmp_path: Path) -> None:
    k = np.random.default_rng(1).normal(size=(4096, 3))
    (tmp_path / "emf.json").write_text(json.dumps({"k_V_s_per_rad": k.tolist()}))
    text = BENCH.replace("[{order = 1, amplitude_V_s_per_rad = 0.2}]", '"emf.json"')
    assert read(tmp_path, text).motor.back_emf_table() == pytest.approx(k)
    (tmp_path / "emf.json").write_text(json.dumps({"k_V_s_per_rad": k[:10].tolist()}))
    with pytest.raises(ConfigError, match=r"is \(10, 3\), expected \(4096, 3\)"):
        read(tmp_path, text).motor.back_emf_table()
    for content, expected in (
        ("[]", "not a back-EMF table: it has no k_V_s_per_rad"),
        ("{}", "not a back-EMF table: it has no k_V_s_per_rad"),
        ('{"k_V_s_per_rad": []}', "k_V_s_per_rad: takes at least one value, got none"),
        ('{"k_V_s_per_rad": [[1, 2, "x"]]}', r"k_V_s_per_rad\[0\]\[2\]: Input should be a valid"),
        (json.dumps({"k_V_s_per_rad": [[0, 1, 1]] * 4096}), "a phase that is zero"),
    ):
        (tmp_path / "emf.json").write_text(content)
        with pytest.raises(ConfigError, match=expected):
            read(tmp_path, text)
    (tmp_path / "emf.json").unlink()
    with pytest.raises(ConfigError, match=r"emf\.json: cannot read the back-EMF table: No such"):
        read(tmp_path, text)


def test_a_phase_without_back_emf_is_refused_each_time(tmp_path: Path) -> None:
    (tmp_path / "emf.json").write_text(json.dumps({"k_V_s_per_rad": [[0.0, 1.0, 1.0]] * 4096}))
    for back_emf in ("[{order = 1, amplitude_V_s_per_rad = 0.0}]", '"emf.json"'):
        text = BENCH.replace("[{order = 1, amplitude_V_s_per_rad = 0.2}]", back_emf)
        for _ in range(2):
            with pytest.raises(ConfigError, match="there is a phase that is zero all over"):
                read(tmp_path, text)


def test_a_motor_with_a_table_holds_it_whole(tmp_path: Path) -> None:
    k = np.random.default_rng(1).normal(size=(4096, 3))
    (tmp_path / "emf.json").write_text(json.dumps({"k_V_s_per_rad": k.tolist()}))
    text = BENCH.replace("[{order = 1, amplitude_V_s_per_rad = 0.2}]", '"emf.json"')
    motor = read(tmp_path, text).motor
    (tmp_path / "emf.json").unlink()
    content = json.loads(json.dumps(motor.model_dump(mode="json")))
    again = config.MotorConfig.model_validate(content)
    assert again == motor
    assert again.back_emf_table() == pytest.approx(k)


def test_a_motor_file(tmp_path: Path) -> None:
    path = tmp_path / "motor.toml"
    start = BENCH.index("[motor]")
    path.write_text(BENCH[start : BENCH.index("[limits]")])
    assert load_motor(path).motor.counts == 4096
    assert load_motor(path).torque_sensor.highpass_time_constant_s == 0.0
    path.write_text(BENCH)
    with pytest.raises(ConfigError, match="unknown key"):
        load_motor(path)


def test_an_unknown_key_in_capitals_is_named(tmp_path):
    path = tmp_path / "bench.toml"
    path.write_text("[Loop]\nrate_Hz = 1000\n")
    with pytest.raises(ConfigError, match=r"Loop: unknown key; did you mean loop\?"):
        load(path)


SOURCE = '[[channels]]\nname = "t"\nunit = "degC"\n[channels.source]\n'


@pytest.mark.parametrize(
    ("old", "new", "tail", "said"),
    [
        ("rate_Hz = 1000", "rate = 1\nspin = 3", "", ["5: loop.rate: unknown", "6: loop.spin:"]),
        (
            "slots = 48", "slots = 0", '[brake]\ndriver = "modbos"\n',
            ["10: motor.slots:", '19: brake.driver: "modbos" is not known; known: sim, none'],
        ),
        (
            "", "", f'{SOURCE}driver = "modbsu"\nregister = 4\n',
            ['22: channels[0].source.driver: "modbsu" is not known; known: modbus, can, serial'],
        ),
        (
            "", "", f"{SOURCE}register = 4\nunit = 2\n",
            ["21: channels[0].source.driver: missing; known: modbus, can, serial, simulated"],
        ),
    ],
)  # fmt: skip
def test_each_thing_that_is_wrong_is_on_a_line_of_its_own(
    tmp_path: Path, old: str, new: str, tail: str, said: list[str]
) -> None:
    """An unknown driver is among them; what no driver has is not, where there is none."""
    with pytest.raises(ConfigError) as caught:
        read(tmp_path, (BENCH.replace(old, new) if old else BENCH) + tail)
    assert len(caught.value.lines) == len(said)
    for line, beginning in zip(caught.value.lines, said, strict=True):
        assert line.startswith(f"{tmp_path / 'bench.toml'}:{beginning}")
