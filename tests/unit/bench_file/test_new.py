"""`motord new`: whatever is answered, there is a bench file that can be read, or a reason."""

import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from motord.bench_file.commented import new_bench_file
from motord.bench_file.questions import QUESTIONS, Question, get
from motord.bench_file.templates import INVERTERS, TEMPLATES
from motord.cli import app
from motord.cli.setup.new import _by_questions
from motord.config import Config, ConfigError, load, packaged
from motord.config.rules.check_notes import hidden_faults
from motord.config.rules.torque import dead_sensor_error_Nm, found_late_s
from motord.config.text.descriptions import field_of

WHERE = Path("/nowhere/first.toml")
REAL = [name for name, template in TEMPLATES.items() if template.real]

ANSWERS = {
    "int": ["1", "0", "-3", "7", "100", "2_000", "4096", "1048577", "99999999999999999999"],
    "float": ["0.2", "0", "1", "-1", "3e-3", "50", "1e308", "inf", "nan", "1_000.5"],
    "text": [
        "x",
        "",
        "none",
        "star",
        "modbus",
        "rtu",
        "tcp",
        "/dev/ttyUSB0",
        'a"b\\',
        "é\x7f\n",
        "\ud800",
    ],
}
ANY = [text for texts in ANSWERS.values() for text in texts]


def bench(template: str, inverter: str = "", **answers: str) -> Any:
    """Return what is written; `motor__pole_pairs="4"` answers `motor.pole_pairs`."""
    by_key = {key.replace("__", "."): text for key, text in answers.items()}
    return new_bench_file(template, inverter, by_key, None, WHERE)


@pytest.mark.parametrize("template", TEMPLATES)
def test_a_template_alone_is_a_bench(template: str) -> None:
    text, config = bench(template)
    assert config.bench.name == "first"
    assert max(map(len, text.splitlines())) <= 100 or "command_constants" in text
    assert ("CHECK" in text) == TEMPLATES[template].real


@pytest.mark.parametrize("template", REAL)
@pytest.mark.parametrize("inverter", INVERTERS)
def test_every_inverter_goes_with_every_bridge(template: str, inverter: str) -> None:
    text, config = bench(template, inverter)
    named = inverter not in ("phase-currents", "dq")
    assert config.inverter.can is not None
    assert config.inverter.can.dbc.exists()
    signals = text[text.index("[inverter.can.signals]") : text.index("\n[bridge")]
    assert ("CHECK" in signals) != named
    assert config.motor.connection == ("independent" if inverter == "phase-currents" else "star")


QUESTION = st.sampled_from(QUESTIONS).flatmap(
    lambda q: st.tuples(st.just(q.key), st.sampled_from([*ANY, *q.choices * 4]))
)


@given(
    template=st.sampled_from([*TEMPLATES, *REAL]),
    inverter=st.sampled_from(["", *INVERTERS]),
    answers=st.lists(QUESTION, max_size=5).map(dict),
)
def test_any_answers_are_a_bench_or_a_reason(
    template: str, inverter: str, answers: dict[str, str]
) -> None:
    try:
        text, config = new_bench_file(template, inverter, answers, None, WHERE)
    except ConfigError:
        return
    written = tomllib.loads(text)
    text.encode()
    for key, answer in answers.items():
        value = get(written, key)
        assert value is not None
        if field_of(key).annotation in (int, float):
            assert value == tomllib.loads(f"v = {answer}")["v"]
        elif field_of(key).annotation is str:
            assert value == answer
    assert config.limits.trip_current_A > config.limits.current_A


@pytest.mark.parametrize("template", REAL)
@pytest.mark.parametrize("question", [q for q in QUESTIONS if q.choices], ids=lambda q: q.key)
def test_every_choice_goes_with_the_example(template: str, question: Question) -> None:
    for choice in question.choices:
        assert bench(template, **{question.key: choice})


def largest_torque_of_a_plan(config: Config) -> float:
    return max(config.plans.of("calibrate", type(config.plans.calibrate)).torques_Nm)


def test_limits_begin_small_and_follow_the_motor() -> None:
    _, config = bench("serial-bridge", motor__rated_torque_Nm="30", motor__back_emf="0.5")
    assert config.limits.torque_Nm == 10.0
    rated_A = config.motor.rated_current_A()
    assert rated_A == pytest.approx(30 / (1.5 * 0.5))
    assert 0.7 * rated_A < config.limits.current_A < 0.8 * rated_A
    assert config.limits.trip_current_A > config.limits.current_A > config.limits.i2t_current_A
    assert largest_torque_of_a_plan(config) == config.limits.torque_Nm


def test_no_plan_exceeds_a_torque_limit_of_many_digits() -> None:
    _, config = bench("serial-bridge", limits__torque_Nm="3.337")
    assert largest_torque_of_a_plan(config) == config.limits.torque_Nm == 3.337


def test_a_trip_limit_that_follows_and_is_beyond_its_bound_is_named() -> None:
    answers = {"limits.torque_Nm": "600000", "limits.current_A": "50000"}
    with pytest.raises(ConfigError, match=r"limits\.trip_torque_Nm: .* or equal to 1000000"):
        new_bench_file("serial-bridge", "", answers, None, WHERE)


def test_more_torque_asked_for_has_the_current_for_it() -> None:
    _, config = bench("serial-bridge", limits__torque_Nm="6")
    assert config.limits.current_A > 1.2 * config.motor.rated_current_A()


@pytest.mark.parametrize("template", ["emulated", "emulated-dq"])
@pytest.mark.parametrize("rate_Hz", [100, 500, 5000])
def test_an_emulated_bench_at_another_rate(template: str, rate_Hz: int) -> None:
    _, config = bench(template, loop__rate_Hz=str(rate_Hz))
    assert config.loop.rate_Hz == rate_Hz


@pytest.mark.parametrize(
    ("template", "inverter", "answers", "expected"),
    [
        ("simulated", "", {"motor__pole_pairs": "4"}, "--motor-pole-pairs.*rig of this template"),
        ("emulated", "vesc", {}, "--inverter is for a real bench"),
        ("serial-bridge", "vesc2", {}, "no inverter vesc2; there are .*odrive"),
        ("can", "", {}, "no template can; there are .*can-bridge"),
        ("can-bridge", "", {"bridge__port": "/dev/x"}, "--bridge-port: this bench has no such"),
        ("serial-bridge", "", {"brake__driver": "sim"}, "--brake-driver: one of modbus, none"),
        ("serial-bridge", "dq", {"motor__connection": "independent"}, "it takes a star"),
        ("serial-bridge", "", {"drive__modbus__watchdog_s": "0"}, "turn the rotor for ever"),
        ("serial-bridge", "", {"motor__back_emf": "0"}, "--motor-back-emf: an amplitude above 0"),
        ("serial-bridge", "", {"motor__back_emf": "k.json"}, r"/nowhere/k.json: cannot read"),
        ("serial-bridge", "", {"motor__pole_pairs": "4.5"}, "--motor-pole-pairs: .*integer"),
        ("serial-bridge", "", {"motor__pole_pairs": "-1"}, r"equal to 1, not '-1'$"),
    ],
)
def test_a_wrong_answer_is_refused_with_the_reason(
    template: str, inverter: str, answers: dict[str, str], expected: str
) -> None:
    with pytest.raises(ConfigError, match=expected):
        bench(template, inverter, **answers)


@pytest.mark.parametrize("device", ["brake", "drive"])
def test_a_device_on_modbus_tcp(device: str) -> None:
    answers = {f"{device}__modbus__transport": "tcp", f"{device}__modbus__host": "192.168.7.20"}
    text, config = bench("serial-bridge", **answers)
    modbus = getattr(config, device).modbus
    assert (modbus.transport, modbus.host, modbus.tcp_port) == ("tcp", "192.168.7.20", 502)
    table = text.partition(f"[{device}.modbus]")[2].partition("\n\n")[0]
    assert "serial_port" not in table
    assert "baud" not in table


@pytest.mark.parametrize("tau_s", [0.0, 0.7, 2.0, 20.0])
@pytest.mark.parametrize("torque_Nm", ["0.3", "6", "41.7"])
def test_a_dead_torque_sensor_is_noticed(tau_s: float, torque_Nm: str) -> None:
    answers = {"torque_sensor__highpass_time_constant_s": str(tau_s)}
    _, config = bench("serial-bridge", limits__torque_Nm=torque_Nm, **answers)
    limits = config.limits
    assert 0.2 * limits.torque_Nm < limits.greatest_torque_error_Nm
    late_s = found_late_s(config.loop.rate_Hz, config.sample_rate_Hz)
    assert limits.greatest_torque_error_Nm < dead_sensor_error_Nm(limits, tau_s, late_s)
    assert not [note for note in hidden_faults(config) if "torque sensor" in note]


def test_a_high_pass_that_hides_a_dead_torque_sensor_is_named() -> None:
    answers = {"torque_sensor__highpass_time_constant_s": "0.2"}
    _, config = bench("serial-bridge", limits__torque_Nm="6", **answers)
    [note] = hidden_faults(config)
    assert "a torque sensor that stays at zero may go unnoticed" in note
    assert "its high-pass of 0.2 s leaves too little of the 6 Nm" in note
    both = "both a faster torque_rate_Nm_per_s and a shorter torque_error_s"
    assert re.search(rf"torque_error_Nm less than 0\.\d+ or {both}$", note)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"current_error_A": 21.0}, "a drive without any current may go unnoticed"),
        ({"current_error_A": 16.4}, "16.4 A may be missing; current_error_A less than 16.3"),
        (
            {"current_A": 12.0, "torque_error_Nm": 4.2},
            "[limits] let no more than 3.79 Nm be reached; what would show it: "
            "torque_error_Nm less than 3.02",
        ),
    ],
)
def test_what_limits_hide_is_named(changed: dict[str, float], says: str) -> None:
    config = load(packaged("sim.toml"))
    limits = {**config.limits.model_dump(exclude_unset=True), **changed}
    sensor = {"highpass_time_constant_s": 0.0}
    tables = {**config.model_dump(exclude_unset=True), "limits": limits, "torque_sensor": sensor}
    assert says in " ".join(hidden_faults(Config.model_validate(tables)))


@pytest.mark.parametrize(("i2t_current_A", "named"), [(30.0, True), (29.9, False)])
def test_a_current_for_ever_that_no_command_exceeds_is_named(
    i2t_current_A: float, named: bool
) -> None:
    note = "i2t_current_A = 30 may flow for ever, and no more than current_A = 30 is commanded"
    assert (note in hidden(limits={"i2t_current_A": i2t_current_A})) is named


def hidden(**sections: Any) -> str:
    tables = load(packaged("sim.toml")).model_dump(exclude_unset=True)
    for name, section in sections.items():
        tables[name] = {**tables.get(name, {}), **section}
    return " ".join(hidden_faults(Config.model_validate(tables)))


@pytest.mark.parametrize(
    ("tau_s", "changed", "shown"),
    [
        (0.05, {}, "both a faster torque_rate_Nm_per_s and a shorter torque_error_s"),
        (0.5, {"torque_rate_Nm_per_s": 5.0}, "a faster torque_rate_Nm_per_s"),
        (0.2, {"torque_error_Nm": 0.3, "torque_error_s": 0.3}, "a shorter torque_error_s"),
        (0.002, {"torque_error_Nm": 4.7}, "nothing"),
    ],
)
def test_what_would_show_a_dead_torque_sensor_does(
    tau_s: float, changed: dict[str, float], shown: str
) -> None:
    sensor = {"highpass_time_constant_s": tau_s}
    note = hidden(torque_sensor=sensor, limits=changed)
    assert shown in note.partition("what would show it: ")[2]
    changes = {"faster": {"torque_rate_Nm_per_s": 1e6}, "shorter": {"torque_error_s": 0.0042}}
    for word, setting in changes.items():
        if word in shown:
            changed = changed | setting
    if shown != "nothing":
        assert "torque sensor" not in hidden(torque_sensor=sensor, limits=changed)


@pytest.mark.parametrize("delay_s", [0.0008, 0.02])
def test_a_torque_error_that_would_show_a_dead_sensor_is_legal(delay_s: float) -> None:
    """At 20 ms of delay a ramp would be an error of it for longer than it may."""
    tables: dict[str, dict[str, float]] = {
        "torque_sensor": {"highpass_time_constant_s": 0.1},
        "inverter": {"actuation_delay_s": delay_s},
        "limits": {"torque_error_s": 0.1, "torque_rate_Nm_per_s": 20.0},
    }
    named = hidden(**tables).partition("torque_error_Nm less than ")[2]
    assert bool(named) == (delay_s < 0.02)
    if named:
        tables["limits"]["torque_error_Nm"] = 0.99 * float(named.split()[0])
        assert "torque sensor" not in hidden(**tables)


@pytest.mark.parametrize("tau_s", [0.0, 2.0])
def test_a_motor_that_makes_no_torque_at_some_angles_can_be_checked(tau_s: float) -> None:
    third = {"connection": "star", "back_emf": [{"order": 3, "amplitude_V_s_per_rad": 0.2}]}
    note = hidden(motor=third, torque_sensor={"highpass_time_constant_s": tau_s})
    assert "a drive without any current may go unnoticed" in note
    assert "nothing would show it there" in note


def test_what_was_answered_needs_no_check() -> None:
    text, _ = bench("serial-bridge", motor__slots="48", brake__driver="none")
    assert not re.search(r"^slots = 48 .*CHECK", text, re.M)
    assert re.search(r"^counts = 4096  # CHECK", text, re.M)
    assert re.search(r'^\[brake\]\ndriver = "none"', text, re.M)


@pytest.mark.parametrize("question", QUESTIONS, ids=lambda q: q.key)
def test_choices_are_those_of_the_key(question: Question) -> None:
    annotation = field_of(question.key).annotation
    if question.key != "motor.back_emf" and get_origin(annotation) is Literal:
        assert set(question.choices) == set(get_args(annotation))


def run(*arguments: str) -> Any:
    return CliRunner().invoke(app, ["new", *arguments])


def test_the_command_writes_a_file_that_can_be_read(tmp_path: Path) -> None:
    file = tmp_path / "my.toml"
    done = run(str(file), "--template", "can-bridge", "--yes", "--motor-pole-pairs", "4")
    assert done.exit_code == 0, done.output
    assert (load(file).motor.pole_pairs, load(file).bench.name) == (4, "my")
    assert f"motord check -c {file}" in done.stdout
    assert re.search(r"\d+ values are an example's: look for CHECK", done.stdout)
    content = file.read_text()
    assert run(str(file), "--template", "simulated", "--yes").exit_code == 1
    assert file.read_text() == content
    assert run(str(file), "--template", "simulated", "--yes", "--force").exit_code == 0
    assert load(file).simulated


@pytest.mark.parametrize("wrong", [["--motor-pole-pairs", "x"], ["--motor-counts", "20"]])
def test_nothing_is_written_for_wrong_answers(tmp_path: Path, wrong: list[str]) -> None:
    done = run(str(tmp_path / "b.toml"), "--template", "serial-bridge", "--yes", *wrong)
    assert done.exit_code == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "expected"), [("lost/b.toml", "there is no folder"), (".", "is a folder")]
)
def test_where_no_file_can_be_is_named(tmp_path: Path, name: str, expected: str) -> None:
    done = run(str(tmp_path / name), "--template", "simulated", "--yes", "--force")
    assert (done.exit_code, done.stderr.count("\n")) == (1, 1)
    assert expected in done.stderr


@pytest.mark.parametrize(
    ("template", "options", "corrected"),
    [
        ("serial-bridge", {"motor.pole_pairs": "x"}, {"x": "4"}),
        ("serial-bridge", {"limits.bus_V_min": "50", "limits.bus_V_max": "40"}, {"40": "60"}),
        ("emulated", {"motor.pole_pairs": "4"}, {}),  # a question that it does not have
    ],
)
def test_options_that_do_not_go_together_are_asked_for(
    monkeypatch: pytest.MonkeyPatch,
    template: str,
    options: dict[str, str],
    corrected: dict[str, str],
) -> None:
    asked = []

    def prompt(text: str, default: str, value_proc: Callable[[str], str], err: bool) -> str:
        asked.append(text)
        assert len(asked) < 2 * len(QUESTIONS)
        return value_proc(corrected.get(default, default))

    monkeypatch.setattr("typer.prompt", prompt)
    real = TEMPLATES[template].real
    _, _, config = _by_questions(WHERE, template, "phase-currents" if real else "", options)
    if real:
        for key, answer in options.items():
            value = get(config.model_dump(), key)
            assert value == float(corrected.get(answer, answer))


def test_without_a_terminal_it_wants_a_template(tmp_path: Path) -> None:
    done = run(str(tmp_path / "b.toml"))
    assert done.exit_code == 1
    assert "--template" in done.stderr


@pytest.mark.parametrize("name", ["moteus", "vesc", "odrive", "cia402"])
def test_the_docs_show_the_inverters_that_ship(name: str) -> None:
    page = (Path(__file__).parents[3] / "docs" / "drives.md").read_text()
    assert f"```toml\n{packaged(f'drives/{name}.toml').read_text()}```" in page
