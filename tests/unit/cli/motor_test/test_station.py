"""`motord test --station`: what is scanned, on a terminal and through a pipe, and what is shown."""

import json
import os
import pty
import re
import signal
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest
from typer.testing import CliRunner

from motord.cli import app
from motord.cli.connection_options import Connection
from motord.cli.motor_test import station, testing
from motord.client import ClientError
from tests.unit.cli.motor_test.made_up import TYPE

WIDTH = 60
ASKED = "scan a serial number"
END = "\x04"
STATION = ["test", "pump.toml", "--station"]


@pytest.fixture(autouse=True)
def plain_environment(monkeypatch):
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", str(WIDTH))


class Terminal:
    """A station on a terminal; `steps` are what comes after each time that it asks."""

    def __init__(self, monkeypatch, *steps):
        self.controller, device = pty.openpty()
        self._steps, self._shown = steps, b""
        streams = {"stdin": "r", "stdout": "w", "stderr": "w"}
        opened = {name: os.fdopen(os.dup(device), mode) for name, mode in streams.items()}
        os.close(device)
        operator = threading.Thread(target=self._operate)
        operator.start()
        with monkeypatch.context() as changed:
            for name, stream in opened.items():
                changed.setattr(f"sys.{name}", stream)
            with pytest.raises(SystemExit) as ended:
                app(STATION)
        for stream in opened.values():
            stream.close()
        operator.join()
        os.close(self.controller)
        self.code = ended.value.code
        self.shown = self._shown.decode().replace("\r\n", "\n")

    @property
    def lines(self):
        """What was shown, without colours."""
        return re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", self.shown).splitlines()

    def _type(self, step):
        if isinstance(step, str):
            os.write(self.controller, step.encode())
        else:
            step()

    def _operate(self):
        for number, step in enumerate(self._steps, 1):
            while self._shown.count(ASKED.encode()) < number:
                self._shown += os.read(self.controller, 4096)
            self._type(step)
        while True:
            try:
                self._shown += os.read(self.controller, 4096)
            except OSError:  # all of the other end is closed
                return


def decisions_on(monkeypatch, *cases):
    """Run a station whose motors' limits are those of the cases (serial, limit)."""

    class Limiting(Terminal):
        def _type(self, step):
            if isinstance(step, str):
                return super()._type(step)
            serial, high = step
            Path("pump.toml").write_text(TYPE.replace("0.5", str(high)))
            return super()._type(f"{serial}\n")

    return Limiting(monkeypatch, *cases, END)


CASES = (("1", 0.5), ("2", 0.4), ("3", 0.45))
COLOURS = {"PASS  1": "30;42", "FAIL  2": "37;41", "UNDECIDABLE  3": "30;43"}


def test_each_result_is_as_wide_as_the_terminal_in_words_and_colour(monkeypatch, bench, analysed):
    seen = decisions_on(monkeypatch, *CASES)
    assert seen.code == 0
    for words, colour in COLOURS.items():
        [line] = [line for line in seen.lines if line.strip() == words]
        assert len(line) == WIDTH
        assert f"\x1b[1;{colour}m" in next(x for x in seen.shown.splitlines() if words in x)
    assert seen.lines[-1] == "3 tested: 1 pass, 1 fail, 1 undecidable, 0 error"
    assert sum(line.startswith("certificate: pump-") for line in seen.lines) == 3
    assert len(list(Path().glob("pump-*.html"))) == 3
    assert [call for call in bench.calls if call == "lease released"] == ["lease released"] * 3


@pytest.mark.parametrize(("name", "value"), [("NO_COLOR", "1"), ("TERM", "dumb")])
def test_without_colours_the_result_stands_between_lines(name, value, monkeypatch, bench, analysed):
    monkeypatch.setenv(name, value)
    seen = decisions_on(monkeypatch, *CASES)
    assert not re.search(r"\x1b\[[0-9;]*[34]\d[;m]", seen.shown)
    for words in COLOURS:
        [at] = [at for at, line in enumerate(seen.lines) if line.strip() == words]
        assert seen.lines[at - 1] == seen.lines[at + 1]
        assert re.fullmatch(f"={{{WIDTH},}}", seen.lines[at - 1])


def test_what_is_typed_during_a_test_is_not_tested(monkeypatch, bench, analysed):
    typed = []

    class Typing(Terminal):
        def _operate(self):
            bench.during = lambda: typed.append(os.write(self.controller, b"2\r\n3"))
            super()._operate()

    terminal = Typing(monkeypatch, "1\n", END)
    assert typed
    assert "what was typed before is not tested" in terminal.lines
    assert terminal.lines[-1] == "1 tested: 1 pass, 0 fail, 0 undecidable, 0 error"


def through_a_pipe(monkeypatch, content, *options):
    """Run a station whose input is a pipe; return exit code, stdout and stderr, in lines."""
    reading, writing = os.pipe()
    os.write(writing, content)
    os.close(writing)
    runner = CliRunner()
    with os.fdopen(reading) as stream:
        monkeypatch.setattr(station, "standard_input", stream.fileno)
        done = runner.invoke(app, [*STATION, *options])
    assert isinstance(done.exception, SystemExit | None), repr(done.exception)
    return done.exit_code, done.stdout.splitlines(), done.stderr.splitlines()


def test_lines_that_are_no_serial_number_are_refused_in_a_line_each(monkeypatch, bench, analysed):
    odd = b"\n \n\x1b[A\n" + b"x" * 9000 + b"\n\xff\n4711\r\n4711\nunfinished"
    code, out, err = through_a_pipe(monkeypatch, odd)
    assert code == 0
    refused = [line for line in err if line.startswith("not tested: ")]
    assert len(refused) == 7
    said = ("empty", "empty", "printed", "too long", "UTF-8", "typed twice", "Enter")
    for line, words in zip(refused, said, strict=True):
        assert words in line
    assert out[-1] == "1 tested: 1 pass, 0 fail, 0 undecidable, 0 error"
    assert "PASS  4711" in {line.strip() for line in out}
    assert "\x1b" not in "".join(out)


def test_a_daemon_that_fails_costs_one_test(monkeypatch, bench, analysed):
    open_ = Connection.connect
    tries = iter(range(100))

    @contextmanager
    def failing(connection):
        if next(tries) < 2:
            raise ClientError("unreachable", "no daemon answers")
        with open_(connection) as client:
            yield client

    monkeypatch.setattr(Connection, "connect", failing)
    code, out, err = through_a_pipe(monkeypatch, b"1\n2\n")
    assert code == 1
    assert {"ERROR  1", "PASS  2", "ERROR  the motor may be powered"} <= {x.strip() for x in out}
    assert "no daemon answers" in out
    assert "motord: whether the motor is at rest is not known: no daemon answers" in err
    assert out[-1] == "2 tested: 1 pass, 0 fail, 0 undecidable, 1 error"


def test_a_store_that_fails_is_said_and_the_verdict_stands(monkeypatch, bench, analysed):
    monkeypatch.setattr(testing, "_store", lambda *_: "s3://b: reset")
    code, out, err = through_a_pipe(monkeypatch, b"1\n")
    assert code == 1
    assert "PASS  1" in {line.strip() for line in out}
    assert "motord: s3://b: reset" in err


def test_each_result_is_a_line_of_json(monkeypatch, bench, analysed):
    bench.during = lambda: setattr(bench, "ends_in", "failed")
    code, out, _ = through_a_pipe(monkeypatch, b"1\n", "--json")
    failed, summary = [json.loads(line) for line in out]
    assert failed["error"] == "calibrate failed: a trip; nothing was decided"
    assert (code, summary["summary"]["error"]) == (1, 1)
    bench.ends_in = "done"
    code, out, _ = through_a_pipe(monkeypatch, b"1\n1 \n2\n", "--json")
    results = [json.loads(line) for line in out]
    assert [(one.get("decision"), one.get("serial")) for one in results] == [
        ("pass", "1"), ("pass", "2"), (None, None)
    ]  # fmt: skip
    assert Path(results[0]["certificate"]).exists()
    assert results[-1] == {"summary": {"pass": 2, "fail": 0, "undecidable": 0, "error": 0}}
    assert code == 0


def test_a_serial_number_tested_before_is_said_with_its_verdict(monkeypatch, bench, analysed):
    through_a_pipe(monkeypatch, b"1\n2\n")
    _, out, _ = through_a_pipe(monkeypatch, b"1\n2\n1\n")
    said = [line for line in out if line.startswith("testing ")]
    assert re.fullmatch(r"testing 1, which was tested before: pass, \d{4}-.* UTC", said[0])
    assert said[2] == "testing 1, which was tested before: pass"


def test_a_signal_while_it_waits_ends_the_station(monkeypatch, bench, analysed):
    seen = Terminal(monkeypatch, "1\n", lambda: os.kill(os.getpid(), signal.SIGTERM))
    assert seen.code == 0
    assert seen.lines[-1] == "1 tested: 1 pass, 0 fail, 0 undecidable, 0 error"


def test_an_interrupt_aborts_the_plan_and_ends_the_station(monkeypatch, bench, analysed):
    def interrupted():
        raise KeyboardInterrupt

    bench.during = interrupted
    seen = Terminal(monkeypatch, "1\n")
    assert seen.code == 1
    assert bench.calls[-1] == "abort"
    assert "calibrate aborted: a trip; nothing was decided" in seen.lines
    assert seen.lines[-1] == "1 tested: 0 pass, 0 fail, 0 undecidable, 1 error"


def test_an_interrupt_ends_the_station_where_the_plan_cannot_be_aborted(
    monkeypatch, bench, analysed
):
    def interrupted():
        raise KeyboardInterrupt

    def no_reply():
        raise ClientError("timeout", "bench b has not answered within 10 s")

    bench.during, bench.abort_plan = interrupted, no_reply
    seen = Terminal(monkeypatch, "1\n")
    assert seen.code == 1
    assert "interrupted; bench b has not answered within 10 s" in seen.lines
    assert seen.lines[-1] == "1 tested: 0 pass, 0 fail, 0 undecidable, 1 error"


def test_a_motor_that_is_powered_after_its_test_is_said(monkeypatch, bench, analysed):
    monkeypatch.setattr(station, "REST_S", -1.0)
    rest = bench.state()
    rest.state, rest.lease.holder = "ENABLED", "bob"
    bench.state = lambda: rest
    _, out, err = through_a_pipe(monkeypatch, b"1\n")
    assert "ERROR  the motor may be powered" in {line.strip() for line in out}
    assert "motord: bench b is ENABLED, by bob" in err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--serial", "1"), "leave out --serial"),
        (("--recordings", "a.mcap"), "leave out --serial and RUN"),
    ],
)
def test_a_station_reads_its_serial_numbers(options, said, monkeypatch, bench):
    done = CliRunner().invoke(app, [*STATION, *options])
    assert done.exit_code == 2
    assert said in " ".join(done.stderr.replace("│", " ").split())


def test_a_station_that_cannot_work_does_not_begin(monkeypatch, bench, analysed):
    done = CliRunner().invoke(app, [*STATION, "--certificate", "nowhere"])
    assert (done.exit_code, done.stderr) == (
        *(1, "motord: nowhere: no such folder for the certificate\n"),
    )
    Path("pump.toml").write_text(TYPE[: TYPE.index("[[plan")] + TYPE[TYPE.index("[[limit") :])
    done = CliRunner().invoke(app, STATION)
    assert (done.exit_code, done.stderr) == (1, "motord: pump.toml: has no [[plan]] to run\n")
    assert bench.calls == []
