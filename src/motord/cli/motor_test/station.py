"""`motord test --station`: motors one after the other, by the serial numbers that are scanned."""

import json
import os
import select
import sys
import termios
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import typer

from motord.cli.bench.lease_session import interrupted_once
from motord.cli.console import explanation, fail, plain_console, print_line, remark
from motord.cli.motor_test.testing import MotorTestError, MotorTests, TestedMotor

KEPT_BYTES = 4096
"""Of a line that goes on and on, what is kept of it."""
REST_S = 5.0
"""Within which a bench whose plan has ended and whose lease was given back is disabled."""

STYLES = {
    "pass": "bold black on green",
    "fail": "bold white on red",
    "undecidable": "bold black on yellow",
    "error": "bold white on magenta",
}


def run_station(tests: MotorTests, folder: Path, *, as_json: bool) -> int:
    """Test motors until the input ends or a signal comes; return the exit code.

    A test that fails for whatever reason of the bench, the files or the daemon is an error of that
    test alone.
    """
    from motord.verdict.motor_type import load_motor_type

    if not load_motor_type(tests.motor_type).plan:
        fail(f"{tests.motor_type}: has no [[plan]] to run")
    lines = ScannedLines(standard_input())
    station = _Station(tests, folder, as_json=as_json)
    with interrupted_once(), suppress(KeyboardInterrupt):
        station.serve(lines)
    station.say(station.shift.to_text(), {"summary": dict(station.shift.counts)})
    return 0 if station.all_stored and not station.shift.counts["error"] else 1


def standard_input() -> int:
    """Return the descriptor of standard input."""
    return sys.stdin.fileno()


class ScannedLines:
    """What a bar-code reader types, from a terminal or pipe; a line without its end is none."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._rest = b""

    def read(self) -> bytes | None:
        """Wait for the next line and return it without its end; None if no more can come."""
        while b"\n" not in self._rest:
            try:
                data = os.read(self._descriptor, KEPT_BYTES)
            except OSError:  # EIO: the terminal is gone
                data = b""
            if not data:
                return None
            self._rest = self._rest[:KEPT_BYTES] + data
        line, _, self._rest = self._rest.partition(b"\n")
        return line.removesuffix(b"\r")

    @property
    def unfinished(self) -> bytes:
        """What came after the last line that has an end."""
        return self._rest

    def discard_typed(self) -> bool:
        """Forget what was typed on a terminal and not read; return whether there was anything."""
        if not os.isatty(self._descriptor):
            return False
        typed = bool(self._rest or select.select([self._descriptor], [], [], 0)[0])
        termios.tcflush(self._descriptor, termios.TCIFLUSH)
        self._rest = b""
        return typed


class _Station:
    """The tests of a shift, and what is printed of them."""

    def __init__(self, tests: MotorTests, folder: Path, *, as_json: bool) -> None:
        from motord.verdict.shift import Shift

        self.shift = Shift()
        self.all_stored = True
        self._tests, self._folder, self._as_json = tests, folder, as_json

    def serve(self, lines: ScannedLines) -> None:
        """Test one motor for each line that is a serial number. Raises KeyboardInterrupt."""
        from motord.verdict.serial import SerialError

        while True:
            if lines.discard_typed():
                remark("what was typed before is not tested")
            self.say("scan a serial number")
            if (line := lines.read()) is None:
                break
            try:
                self._test(self.shift.serial_of(line, time.monotonic()))
            except SerialError as error:
                remark(f"not tested: {error}")
        if lines.unfinished:
            remark("not tested: what came last had no Enter after it")

    def say(self, line: str, content: dict[str, Any] | None = None) -> None:
        """Print a line for people, or with --json its content, if it has any."""
        if not self._as_json:
            print_line(line)
        elif content is not None:
            print_line(json.dumps(content))

    def _test(self, serial: str) -> None:
        from motord.verdict.shift import earlier_verdict

        before = self.shift.earlier(serial) or earlier_verdict(
            self._folder, self._tests.motor_type, serial
        )
        again = f", which was tested before: {before}" if before else ""
        self.say(f"testing {serial}{again}")
        try:
            self._run(serial)
        finally:
            self._check_rest()
            self.shift.ended_s = time.monotonic()

    def _run(self, serial: str) -> None:
        """Test a motor. Raises KeyboardInterrupt, and what is an error of the program."""
        try:
            tested = self._tests.run(serial, certificate=self._folder)
        except KeyboardInterrupt:
            self._failed(serial, "interrupted; nothing was decided")
            raise
        except typer.Exit:
            self._failed(serial, "nothing was decided")
        except Exception as error:
            if (message := explanation(error)) is None:
                raise
            self._failed(serial, message)
            if isinstance(error, MotorTestError) and error.interrupted:
                raise KeyboardInterrupt from error
        else:
            self._decided(serial, tested)

    def _decided(self, serial: str, tested: TestedMotor) -> None:
        made, path = tested.certificate, tested.path
        decision = made.verdict.decision
        self.shift.add(serial, decision)
        for reason in made.verdict.reasons():
            self.say(f"- {reason}")
        self._show(decision, serial)
        self.say(f"certificate: {path}", {**made.to_json(), "certificate": str(path)})
        if tested.not_stored:
            self.all_stored = False
            remark(f"motord: {tested.not_stored}")
        self.say(self.shift.to_text())

    def _failed(self, serial: str, why: str) -> None:
        self.shift.add(serial, "error")
        self._show("error", serial)
        self.say(why, {"decision": "error", "serial": serial, "error": why})
        self.say(self.shift.to_text())

    def _show(self, decision: str, text: str) -> None:
        if not self._as_json:
            print_banner(decision, text)

    def _check_rest(self) -> None:
        """Warn of a motor that is powered, or may be, after its test."""
        why = self._powered()
        if why:
            self._show("error", "the motor may be powered")
            remark(f"motord: {why}")

    def _powered(self) -> str:
        """Return why the motor may be powered, "" if it is not."""
        from motord.client import ClientError

        end_s = time.monotonic() + REST_S
        try:
            with self._tests.connection.connect() as client:
                while (state := client.state()).state == "ENABLED":
                    if time.monotonic() > end_s:
                        return f"bench {client.bench} is ENABLED, by {state.lease.holder}"
                    time.sleep(0.1)
        except ClientError as error:
            return f"whether the motor is at rest is not known: {error}"
        return ""


def print_banner(decision: str, text: str) -> None:
    """Print a decision and what it is of, as wide as the terminal; in colour where it has any."""
    from rich.padding import Padding
    from rich.text import Text

    console = plain_console()
    words = Text(f"{decision.upper()}  {text}", justify="center", overflow="fold")
    if console.color_system is None or console.no_color:
        edge = Text("=" * console.width)
        for line in (edge, words, edge):
            console.print(line)
    else:
        console.print(Padding(words, (1, 0), style=STYLES[decision]))
