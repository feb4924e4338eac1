"""A short part of the fuzz campaign, and that it finds what is wrong."""

import time

import pytest

from motord.api.requests import parse
from motord.config import ConfigError
from tests.campaigns import fuzz
from tests.campaigns.fuzzing import files, rpc
from tests.campaigns.fuzzing.rpc import Rpc

INPUTS = 200


@pytest.mark.parametrize("name", sorted(fuzz.TARGETS))
def test_nothing_unexplained_comes_out(name):
    inputs = 2 * INPUTS if name == "rpc" else INPUTS  # of a bench that is off, and enabled
    outcome = fuzz.run(name, inputs, seed=7)
    assert not outcome.wrong, outcome.first
    assert outcome.inputs == inputs
    assert inputs / 50 < outcome.taken < inputs


def test_an_input_can_be_had_again():
    assert fuzz.run("map", 20, first=30).taken == fuzz.run("map", 20, first=30).taken


def test_an_exception_is_found(monkeypatch):
    def fragile(path):
        if b"4" in path.read_bytes():
            raise KeyError("no such table")
        raise ConfigError(f"{path}: wrong")

    monkeypatch.setattr(files, "load_map", fragile)
    outcome = fuzz.run("map", 50)
    assert any(where.startswith("KeyError in ") for where in outcome.wrong)


def test_a_recording_that_nobody_checks_is_found(monkeypatch):
    monkeypatch.setattr("motord.recording.reader.misfit", lambda value, schema: "")
    assert {where.split()[0] for where in fuzz.run("json", 200).wrong} >= {"KeyError", "TypeError"}


def test_a_silent_error_is_found(monkeypatch):
    def silent(path):
        raise ConfigError("wrong")

    monkeypatch.setattr(files, "load_map", silent)
    assert sum(fuzz.run("map", 20).wrong.values()) == 20


def test_a_request_carried_out_without_the_lease_is_found(monkeypatch):
    monkeypatch.setattr(
        "motord.service.bench.lease.CommandLease.require", lambda self, token, now_ns: self._held
    )
    outcome = fuzz.run("rpc", 300)
    assert any("without the lease" in finding for finding in outcome.first.values())


def test_a_change_by_a_refused_request_is_found(monkeypatch):
    def careless(asked, payload):
        target.service.bench.setpoint.brake = 0.123
        return parse(asked, payload)

    target = Rpc()
    monkeypatch.setattr(fuzz, "TARGETS", {"rpc": lambda: target})
    monkeypatch.setattr(rpc, "parse", careless)
    outcome = fuzz.run("rpc", 50)
    assert any("changed something" in finding for finding in outcome.first.values())


def test_a_hang_is_found(monkeypatch):
    def endless(path):
        while True:
            time.sleep(0.01)

    monkeypatch.setattr(files, "load_map", endless)
    monkeypatch.setattr(fuzz, "HANG_S", 1)
    assert [w.split()[0] for w in fuzz.run("map", 1).wrong] == ["HangError"]
