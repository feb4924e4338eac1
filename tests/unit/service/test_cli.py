"""The commands that operate a bench, against the daemon's own pieces over loopback."""

import json
import re
import socket
import threading
from contextlib import contextmanager

import pytest
import typer
from typer.testing import CliRunner

from motord import config
from motord.cli import app
from motord.cli.bench import operate
from motord.cli.bench.shared_token import folder, shared
from motord.cli.bench.status import sensor_text
from motord.cli.plan.settings import parse_settings
from motord.client import ClientError, Commander, Subscription, connect
from motord.schema import State, Trip
from tests.contract.peers import until
from tests.support.patience import PATIENCE_S
from tests.support.ports import free_port
from tests.unit.emulate.benches import write_bench
from tests.unit.service.live_service import endpoint, live_service

UNHURRIED = ("--limit-s", "3600")
"""For dry runs whose forecasts are asked: by default they end after two minutes, done or not."""
UNDONE = re.compile(r"motord: the bench is (OFF$|(OFF|READY), and what was set is undone)", re.M)
"""A stop undoes what was set at once; the loop is OFF some ticks later. Either may be seen."""


@pytest.fixture(scope="module")
def live(tmp_path_factory):
    with live_service(tmp_path_factory.mktemp("state"), name="cli") as service:
        yield service


@pytest.fixture(autouse=True)
def off(live):
    """Start every test with a bench that is OFF and that nobody commands."""
    yield
    with connect("cli", live.listen) as client:
        with client.lease("teardown", force=True) as lease:
            client.rpc("stop")
            client.rpc("reset", token=lease.token)
            client.rpc("stop")
        until(lambda: client.state().lease.holder is None)  # it may not be given back in time


@pytest.fixture
def motord(live, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr("motord.cli.bench.operate.LATE_S", PATIENCE_S)  # of a busy computer

    def run(*arguments):
        return CliRunner().invoke(app, [*arguments, "--bench", "cli", "--connect", live.listen])

    return run


def given(*settings):
    return [argument for setting in settings for argument in ("--set", setting)]


ONE_POINT = given("torques_Nm=2", "speeds_Hz=1.0", "turns=2", "settle_s=0", "gain_steps=[]")


@contextmanager
def meanwhile(work):
    """Have another terminal do something; wait for it at the end."""
    thread = threading.Thread(target=work)
    thread.start()
    yield
    thread.join()


@pytest.fixture
def when_enabled(live):
    """Return a context in which something is done once the bench is enabled."""

    def context(work):
        def wait():
            with connect("cli", live.listen) as client, client.subscribe_state() as states:
                while states.get(PATIENCE_S).state != "ENABLED":
                    pass
                work(client)

        return meanwhile(wait)

    return context


def printed(result):
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def failed(result):
    assert result.exit_code == 1, result.output
    assert len(result.stderr.strip().splitlines()) == 1
    return result.stderr


def test_nobody_there_is_one_line_and_exit_1():
    where = endpoint()
    result = CliRunner().invoke(app, ["status", "--connect", where])
    assert failed(result) == f"motord: no motord at {where}: is `motord run` running there?\n"


def test_status_as_table_and_as_json(motord):
    text = motord("status").stdout
    for part in ("axial-flux 48/16", "OFF", "nobody", "not recording", "simulated", " Hz"):
        assert part in text
    assert printed(motord("status", "--json"))["state"] == "OFF"


def test_a_note_says_where_it_is(motord, live):
    live.recording_file = ""
    assert "the events alone: nothing is being recorded" in motord("note", "fan", "on").stdout
    live.recording_file = "/runs/cli-000.mcap"
    assert motord("note", "door open").stdout == "noted in /runs/cli-000.mcap\n"
    assert printed(motord("note", "x", "--json"))["recording"] == "/runs/cli-000.mcap"
    assert "fan on" in motord("events", "--no-follow").stdout
    assert "printable" in failed(motord("note", "a\nb"))


def test_watch_shows_states_for_a_while(motord):
    lines = motord("watch", "--json", "--for-s", "0.3").stdout.splitlines()
    assert all(json.loads(line)["bench"] == "cli" for line in lines)
    assert lines
    assert "OFF" in motord("watch", "--for-s", "0.2").stdout


def test_enable_holds_the_lease_and_then_lets_the_bench_ramp_down(live, motord):
    result = motord("enable", "--for-s", "0.5")
    assert result.exit_code == 0
    assert result.stdout == "ENABLED\n"
    assert "in command for 0.5 s" in result.stderr
    with connect("cli", live.listen) as client, client.subscribe_state() as states:
        while states.get(PATIENCE_S).state != "READY":
            pass
    assert list(folder("cli").iterdir()) == []


def test_set_uses_the_lease_that_another_terminal_holds(live, motord):
    enabled = threading.Event()
    outcome = []

    def first_terminal():
        with (
            connect("cli", live.listen) as client,
            client.lease("anna") as lease,
            shared("cli", lease.token),
        ):
            client.rpc("enable", token=lease.token)
            enabled.set()
            done.wait(PATIENCE_S)
            outcome.append(lease.lost.is_set())

    done = threading.Event()
    thread = threading.Thread(target=first_terminal)
    thread.start()
    assert enabled.wait(PATIENCE_S)
    answer = printed(motord("set", "--torque-Nm", "1", "--speed-Hz", "0.5", "--json"))
    assert answer["setpoint"]["speed_Hz"] == 0.5
    said = motord("set", "--torque-Nm", "0.5").stdout
    assert "set: torque 0.5 Nm, reached in " in said
    assert "speed 0.5 Hz" in said
    reached = said.splitlines()[1]
    assert reached.startswith("reached: torque 0.5 Nm commanded, ")
    assert "without the mean, which this sensor does not pass (high-pass, 2 s)" in reached
    assert reached.endswith(" Hz of 0.5 Hz")
    assert printed(motord("disable", "--json")) == {"state": "READY"}
    done.set()
    thread.join()
    assert outcome == [False]


def test_set_can_enable_and_hold_by_itself(live, motord):
    result = motord("set", "--enable", "--torque-Nm", "1", "--speed-Hz", "0.5", "--for-s", "0.3")
    assert result.exit_code == 0
    assert "request: enable" in "\n".join(live.messages())


@pytest.fixture
def ready(live):
    """Bring the bench to READY."""
    with connect("cli", live.listen) as client, client.lease("setup") as lease:
        client.rpc("enable", token=lease.token)
        assert client.rpc("disable", token=lease.token)["state"] == "READY"


@pytest.mark.usefixtures("ready")
@pytest.mark.parametrize("asked", [("--drive-Hz", "0.5"), ("--brake", "0.5")])
def test_what_is_set_without_torque_is_held_until_somebody_stops_it(live, motord, asked):
    set_point = live.bench.setpoint

    def stop_when_set():
        with connect("cli", live.listen) as client, client.subscribe_state() as states:
            for _ in range(10):  # a second
                while not (s := states.get(PATIENCE_S).setpoint).drive_Hz and not s.brake:
                    pass
            assert 0.5 in (set_point.drive_Hz, set_point.brake)
            client.rpc("stop", by="another terminal")

    with meanwhile(stop_when_set):
        result = motord("set", *asked)
    assert result.exit_code == 1
    assert "in command until Ctrl-C; then brake and drive rest" in result.stderr
    assert UNDONE.match(result.stderr.splitlines()[-1])


def test_what_is_undone_before_the_first_look_is_noticed(live, motord, monkeypatch):
    def stop_at_once(*announced):
        with connect("cli", live.listen) as client:
            client.rpc("stop", by="another terminal")

    monkeypatch.setattr(operate, "announce", stop_at_once)
    result = motord("set", "--brake", "0.5", "--for-s", "5")
    assert result.exit_code == 1
    assert UNDONE.match(result.stderr)


@pytest.mark.usefixtures("ready")
def test_what_is_set_without_torque_lasts_as_long_as_it_is_asked_for(live, motord):
    assert motord("set", "--drive-Hz", "0.5", "--for-s", "0.5").exit_code == 0
    assert live.bench.setpoint.drive_Hz == 0.0
    assert "gave up command" in live.messages()[-1]


def test_a_sensor_that_passes_the_mean_is_believed(live):
    with connect("cli", live.listen) as client:
        state = client.state()
    assert "ripple" in sensor_text(state)
    state.torque_sensor.highpass_time_constant_s = 0.0
    state.tick.torque_Nm = 1.25
    assert sensor_text(state) == "1.25 Nm measured"


def test_set_without_enable_says_what_to_do(motord):
    assert "enable it first" in failed(motord("set", "--torque-Nm", "1"))


def test_set_of_nothing_is_wrong_usage(motord):
    assert motord("set").exit_code == 2


BOX = "/runs/blackbox/blackbox-[cli]-1.mcap"


def test_a_trip_ends_the_hold_and_is_reported_with_all_that_helps(
    live, motord, monkeypatch, when_enabled
):
    monkeypatch.setattr(live.bench.monitor, "on_trip", lambda t_ns, tick, account: BOX)

    def trip(client):
        memory = live.loop.virtual._memory
        memory["trip_bits"] = memory["first_trip"] = Trip.OVER_SPEED
        memory["state"] = State.TRIPPED

    with when_enabled(trip):
        result = motord("enable", "--json")
    assert result.exit_code == 1
    assert "the bench is TRIPPED: OVER_SPEED" in result.stderr
    expected = ("OVER_SPEED", "limit 25", "check that the brake answers", "motord reset", BOX)
    for said in (result.stderr, failed(motord("enable")), motord("status").stdout):
        assert [part for part in expected if part not in said] == []
    events = motord("events", "--no-follow").stdout.splitlines()
    [number] = [n for n, line in enumerate(events) if "-> TRIPPED" in line]
    for line, part in zip(events[number:], ("limit 25", "`motord reset`", BOX), strict=False):
        assert part in line
    report = printed(motord("status", "--json"))["trip"]
    assert (report["blackbox"], report["first"]) == (BOX, ["OVER_SPEED"])
    assert printed(motord("reset", "--json")) == {"state": "READY"}


def test_a_takeover_ends_the_hold(motord, when_enabled):
    def take_over(client):
        with client.lease("ben", force=True):
            done.wait(PATIENCE_S)

    done = threading.Event()
    with when_enabled(take_over):
        result = motord("enable")
        done.set()
    assert result.exit_code == 1
    assert "ben took over command" in result.stderr


def test_stop_needs_no_lease(live, motord):
    with connect("cli", live.listen) as client, client.lease("anna") as lease:
        client.rpc("enable", token=lease.token)
        assert motord("stop").stdout == "OFF\n"
        assert "anna is in command" in failed(motord("disable"))
        assert motord("disable", "--force").exit_code == 0


def test_events_are_shown(motord):
    motord("stop")
    assert "request: stop" in motord("events", "--no-follow").stdout
    lines = motord("events", "--no-follow", "--json").stdout.splitlines()
    assert "request" in {json.loads(line)["kind"] for line in lines}


def test_plans_are_listed_with_their_settings(motord):
    text = motord("plan", "list").stdout
    assert "    then: motord analyse inertia-oscillation RUN..." in text
    assert "calibrate: " in text
    assert "    turns = 24" in text
    assert {p["name"] for p in printed(motord("plan", "list", "--json"))["plans"]} >= {"verify"}


def test_a_dry_run_shows_points_and_time(motord):
    settings = given("torques_Nm=1,2", "speeds_Hz=0.5")
    arguments = ("plan", "start", "calibrate", *settings, "--dry-run", "--limit-s", "0")
    text = motord(*arguments).stdout
    assert "4 points, about" in text  # two of the mesh, two with scaled currents
    outline = printed(motord(*arguments, "--json"))
    assert outline["settings"]["speeds_Hz"] == [0.5]
    assert outline["forecast"] == []


def test_settings_that_are_wrong_are_reported(motord):
    result = motord("plan", "start", "calibrate", "--set", "torques_Nm=9", "--dry-run")
    assert "[limits] torque_Nm" in failed(result)
    assert motord("plan", "start", "calibrate", "--set", "torques").exit_code == 2
    assert "no plan 'dance'" in failed(motord("plan", "start", "dance", "--dry-run"))
    assert "no calibration is installed" in failed(motord("plan", "start", "verify", "--dry-run"))


def test_a_plan_is_asked_for_without_the_check_if_so_wanted(motord, monkeypatch):
    asked = []

    def start(self, name, settings, **rest):
        asked.append((name, rest["detach"], rest["check"]))
        raise ClientError("refused", "not started")

    monkeypatch.setattr(Commander, "start_plan", start)
    for more in ((), ("--no-check",), ("--detach",), ("--detach", "--no-check")):
        assert "not started" in failed(motord("plan", "start", "verify", *more))
    assert asked == [
        ("verify", detached, checked) for detached in (False, True) for checked in (True, False)
    ]


@pytest.mark.slow
def test_a_dry_run_shows_what_would_become_of_each_point(motord):
    quick = given("turns=2", "settle_s=0.2", "gain_steps=[]", "speeds_Hz=0.8,1.0")
    dry = ("plan", "start", "calibrate", "--dry-run", *quick)
    whole = (*dry, *UNHURRIED)
    result = motord(*whole, "--set", "torques_Nm=2")
    assert result.exit_code == 0, result.output
    first, second, last = result.stdout.splitlines()
    assert first == "   0  2 Nm  0.8 Hz  2 turns  ok"
    assert second == "   1  -2 Nm  -1 Hz  2 turns  ok"
    assert "2 points, about" in last
    poor = motord(*whole, "--set", "torques_Nm=2", "--set", "temperature_C=80,90", "--json")
    assert "2 of 2 points of calibrate would fail or be poor" in failed(poor)
    assert "outside 80 to 90" in json.loads(poor.stdout)["forecast"][1]["quality"]
    hasty = motord(*dry, "--set", "torques_Nm=2", "--limit-s", "1e-6")
    assert "not simulated: no time left" in hasty.stdout
    assert "2 were not simulated: give it more time" in failed(hasty)


@pytest.mark.slow
def test_a_dry_run_names_the_trip_of_a_point(motord):
    tight = given("torques_Nm=1,5", "speeds_Hz=1.0", "settle_timeout_s=0.5", "speed_tolerance=1e-4")
    tight += given("gain_steps=[]")
    result = motord("plan", "start", "calibrate", "--dry-run", *UNHURRIED, *tight)
    assert "2 of 2 points" in failed(result)
    assert "1 Nm, 1 Hz: the speed was still" in result.stdout


def test_a_plan_that_needs_a_hand_is_not_simulated(motord):
    result = motord("plan", "start", "inertia-oscillation", "--dry-run")
    assert result.exit_code == 0, result.output
    assert "not simulated: somebody has to move the rotor by hand" in result.stdout


@pytest.mark.slow
def test_a_plan_is_followed_to_its_end(motord):
    result = motord("plan", "start", "calibrate", *ONE_POINT)
    assert result.exit_code == 0, result.output
    assert "calibrate: 1 of 1 points" in result.stdout
    assert result.stdout.splitlines()[-1] == "next: motord analyse calibrate /runs/calibrate.mcap"
    assert "calibrate done, 100 %, 1/1" in motord("plan", "status").stdout


@pytest.mark.slow
def test_an_aborted_plan_is_resumed_and_followed_to_its_end(motord):
    assert motord("plan", "start", "calibrate", "--detach", *ONE_POINT).exit_code == 0
    motord("stop")
    said = motord("plan", "status").stdout
    assert "calibrate aborted" in said
    assert "left" not in said
    result = motord("plan", "resume")
    assert result.exit_code == 0, result.output
    assert "calibrate: 1 of 1 points" in result.stdout
    assert "none was interrupted" in failed(motord("plan", "resume"))


def test_a_plan_that_is_not_to_be_resumed_is_discarded(motord):
    assert motord("plan", "start", "calibrate", "--detach").exit_code == 0
    assert "abort it first" in failed(motord("plan", "discard"))
    motord("stop")
    assert motord("plan", "discard").stdout == "calibrate: discarded\n"
    assert motord("plan", "status").stdout.startswith("no plan has run")
    assert "no interrupted plan" in failed(motord("plan", "discard"))


def test_a_plan_resumed_in_the_background_is_left_alone(motord):
    assert motord("plan", "start", "calibrate", "--detach").exit_code == 0
    motord("stop")
    assert motord("plan", "resume", "--detach").stdout == "calibrate: running\n"
    assert printed(motord("plan", "status", "--json"))["detached"] is True
    assert motord("plan", "abort").stdout == "calibrate: ending\n"


def test_ctrl_c_aborts_the_plan_that_is_followed(motord, monkeypatch):
    interrupts = [KeyboardInterrupt]
    get = Subscription.get

    def interrupted(self, timeout_s):
        if interrupts:
            raise interrupts.pop()
        return get(self, timeout_s)

    monkeypatch.setattr(Subscription, "get", interrupted)
    result = motord("plan", "start", "calibrate", "--json")
    assert result.exit_code == 1
    assert "calibrate aborted: aborted by" in result.stderr
    assert json.loads(result.stdout)["state"] == "aborted"


def test_a_detached_plan_goes_on_and_is_steered(motord):
    assert "calibrate started" in motord("plan", "start", "calibrate", "--detach").stdout
    assert motord("plan", "pause").stdout.startswith("calibrate: paus")
    assert printed(motord("plan", "status", "--json"))["detached"] is True
    assert motord("plan", "resume").stdout == "calibrate: running\n"
    assert motord("plan", "abort").stdout == "calibrate: ending\n"


def test_settings_become_json_values():
    defaults = {"torques_Nm": [1.0], "turns": 24, "compensate": "off"}
    given = ["torques_Nm=3", "turns=2", "compensate=currents", "speeds_Hz=0.5,0.7", "x=[1]"]
    assert parse_settings(given, defaults) == {
        "torques_Nm": [3], "turns": 2, "compensate": "currents", "speeds_Hz": [0.5, 0.7], "x": [1],
    }  # fmt: skip
    assert parse_settings(["torques_Nm=2Nm, 4"], defaults) == {"torques_Nm": ["2Nm", 4]}
    given = ["inner.turns=12", "inner.torques_Nm=1,2", "plan=verify"]
    assert parse_settings(given, {"inner": {}}) == {
        "inner": {"turns": 12, "torques_Nm": [1, 2]}, "plan": "verify",
    }  # fmt: skip


def test_entries_of_a_table_are_set_over_those_of_the_bench():
    defaults = {"inner": {"turns": 6, "torques_Nm": [1.0]}, "hours": 1.0}
    assert parse_settings(["inner.turns=12"], defaults) == {
        "inner": {"turns": 12, "torques_Nm": [1.0]}
    }
    assert defaults["inner"]["turns"] == 6
    for given in (["inner={}", "inner.turns=12"], ["inner.turns=12", "inner={}"]):
        assert parse_settings(given, defaults) == {"inner": {"turns": 12}}


@pytest.mark.parametrize(
    "wrong",
    [
        ["=3"], [".turns=12"], ["inner.=12"], ["inner..turns=12"], ["turns"], ["hours.x=1"],
        ["inner=3", "inner.turns=12"], ["inner.turns=12", "inner=3"],
    ],
)  # fmt: skip
def test_what_is_no_setting_is_refused(wrong):
    with pytest.raises(typer.BadParameter):
        parse_settings(wrong, {"inner": {}, "hours": 1.0})


@pytest.fixture
def check(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return lambda bench, *options: CliRunner().invoke(app, ["check", "-c", str(bench), *options])


def test_check_names_what_is_wrong(tmp_path, check):
    bench = bench_that_records_to(tmp_path / "runs")
    report = printed(check(bench, "--rt", "--json"))
    assert [f["what"] for f in report["findings"]] == [
        "config", "inverter and bridge", "brake", "drive", "endpoints", "recordings",
    ]  # fmt: skip
    assert {"scheduler", "memory lock"} <= {item["name"] for item in report["realtime"]}
    text = check(bench, "--rt").stdout
    assert "config: ok, bench sim" in text
    assert "real time: scheduler" in text


def without_devices(folder):
    """Write a bench that waits no longer than it must for devices that are not there."""
    short = "connect_timeout_s = 0.1\n"
    tables = ("[brake.modbus]\n", "[drive.modbus]\n")
    return write_bench(folder, {table: table + short for table in tables})


def test_check_of_a_bench_without_its_devices_fails_on_each(tmp_path, check):
    said = failed(check(without_devices(tmp_path)))
    assert "not ready to run: inverter and bridge, brake, drive" in said
    said = failed(check(tmp_path / "no.toml"))
    assert "no.toml: cannot read it" in said
    assert "; motord new writes a bench file" in said


def test_check_notes_a_rig_file_that_is_not_there_of_a_bench_that_is_not_simulated(tmp_path, check):
    bench = without_devices(tmp_path)
    assert "motord emulate cannot be" not in check(bench).stdout
    text, replaced = re.subn("^rig = .*$", 'rig = "none.toml"', bench.read_text(), flags=re.M)
    assert replaced == 1
    bench.write_text(text)
    said = (
        f"note: motord emulate cannot be this bench: [bench] rig: {tmp_path / 'none.toml'}: cannot"
    )
    assert said in check(bench).stdout


def test_check_notes_a_plan_of_the_bench_file_that_is_refused(tmp_path, check):
    bench = bench_that_records_to(tmp_path / "runs")
    refused = "note: [plans.verify] cannot be started as it stands: 99 Nm is above [limits]"
    assert "cannot be started" not in check(bench).stdout
    before, table, after = bench.read_text().partition("[plans.verify]\n")
    after = re.sub("^torques_Nm = .*$", "torques_Nm = [99.0]", after, flags=re.M)
    bench.write_text(before + table + after)
    done = check(bench)
    assert (refused in done.stdout, done.exit_code) == (True, 0)


def bench_that_records_to(folder, free_min_MB=1, listen=None):
    text = config.packaged("sim.toml").read_text()
    text = text.replace('rig = "report.rig.toml"', 'rig = "package:report.rig.toml"')
    path = folder.parent / "bench.toml"
    text += f'\n[recording]\ndirectory = "{folder}"\nfree_min_MB = {free_min_MB}\n'
    listen = listen or f"tcp/127.0.0.1:{free_port()}"
    path.write_text(f'{text}\n[zenoh]\nlisten = ["{listen}"]\n')
    return path


def test_check_says_whether_the_daemon_could_listen(tmp_path, check):
    def found(listen):
        result = check(bench_that_records_to(tmp_path / "runs", listen=listen))
        return result.exit_code, result.output

    with socket.create_server(("127.0.0.1", 0)) as taken:
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        code, said = found(endpoint)
    assert code == 1
    assert f"endpoints: {endpoint}: in use: by a daemon that runs" in said
    code, said = found(endpoint)
    assert (code, f"endpoints: ok, {endpoint}" in said) == (0, True)
    code, said = found(f"unixsock-stream/{tmp_path}/none/bench.sock")
    assert (code, f"{tmp_path}/none: No such file" in said) == (1, True)
    tmp_path.chmod(0o777)
    code, said = found(f"unixsock-stream/{tmp_path}/bench.sock")
    assert (code, "others may write there" in said) == (1, True)
    code, said = found("tcp/127.0.0.1:99999")
    assert code == 1
    assert "zenoh.listen: tcp/127.0.0.1:99999: a port is a number from 1 to 65535" in said
    code, said = found('tcp/127.0.0.1:7447", "tcp/127.0.0.1:7447')
    assert (code, "zenoh.listen: tcp/127.0.0.1:7447 is listed twice" in said) == (1, True)


def test_check_says_whether_a_unix_socket_is_in_use(tmp_path, monkeypatch):
    from motord.cli.check import probe_endpoints
    from motord.config import load

    monkeypatch.chdir(tmp_path)  # a path of a socket is short
    place = tmp_path / "bench.sock"

    def found():
        bench = load()
        listen = (f"unixsock-stream/{place}",)
        zenoh = bench.zenoh.model_copy(update={"listen": listen})
        return probe_endpoints(bench.model_copy(update={"zenoh": zenoh}))

    assert found()["ok"]
    with socket.socket(socket.AF_UNIX) as taken:
        taken.bind("bench.sock")
        taken.listen(1)
        assert not found()["ok"]
        assert found()["message"].endswith("in use: by a daemon that runs, or another program")
    assert found()["ok"]  # what a dead daemon left
    place.unlink()
    place.write_text("")
    assert "which is no socket; move it away" in found()["message"]


def test_check_says_whether_the_daemon_could_let_anybody_in(tmp_path, check):
    path = bench_that_records_to(tmp_path / "runs")
    sockets = f'"tls/127.0.0.1:{free_port()}", "unixsock-stream/{tmp_path}/b.sock"]'
    with path.open("a") as file:
        file.write('socket_group = "none-of-ours"\n[zenoh.tls]\n')
        file.writelines(f'{key} = "{key}"\n' for key in ("ca", "certificate", "key", "roles"))
    path.write_text(re.sub(r"(listen = \[.*)\]", rf"\1, {sockets}", path.read_text()))
    result = check(path)
    assert result.exit_code == 1
    assert "socket_group = 'none-of-ours': there is no such group; " in result.output
    assert f"{tmp_path}/ca: cannot read it: No such file or directory" in result.output


def test_check_says_whether_recordings_can_be_written(tmp_path, check):
    deep, folder = tmp_path / "all" / "runs", tmp_path / "runs"
    path = bench_that_records_to(folder)
    path.write_text(path.read_text().replace(str(folder), str(deep)))
    good = check(path)
    assert good.exit_code == 0
    assert f"recordings: ok, {deep}, " in good.output
    assert not deep.parent.exists()
    folder.write_text("in the way of a folder")
    bad = check(bench_that_records_to(folder))
    assert bad.exit_code == 1
    assert f"recordings: {folder}: cannot write there: File exists" in bad.output
    folder.unlink()
    full = check(bench_that_records_to(folder, 1e9))
    assert full.exit_code == 1
    assert not folder.exists()
    assert "less than recording.free_min_MB" in full.output


@pytest.mark.parametrize("above", ["", "new"])
def test_check_leaves_nothing_behind_where_no_folder_of_recordings_can_be(tmp_path, above):
    from motord.cli.check import probe_recordings

    bench, folder = config.load(), tmp_path / above / ("x" * 300)
    recording = bench.recording.model_copy(update={"directory": folder})
    found = probe_recordings(bench.model_copy(update={"recording": recording}))
    assert "cannot write there: File name too long" in found["message"]
    assert not list(tmp_path.iterdir())
