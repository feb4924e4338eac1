"""An emulator that the computer keeps waiting, in virtual time: it is late, and never wrong.

Feedback that it could not send in time would arrive with the stamp of its arrival, as currents that
do not fit the commands of that time.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import pytest

from motord.emulate.freshness import AGE_MAX_NS, HELD_UP_NS, SILENCE_MAX_NS
from motord.emulate.process import INVERTER_STATUS_HZ
from motord.schema import InverterStatus, State
from tests.support.virtual_wire import STEP_MAX_NS, World, on_the_wire
from tests.system.test_shipped_limits import shipped
from tests.unit.emulate.benches import EMULATED
from tests.unit.service.virtual_service import VirtualService

TORQUE_NM = 0.1
STALL_NS = 60_000_000
EVERY_NS = 150_000_000
PREEMPTED_EVERY = 150
"""Samples from one to the next."""
PREEMPTED_NS = 20_000_000
ROUNDS = 10
SLOW_PERIOD_NS = 1_000_000_000 // INVERTER_STATUS_HZ
"""Much longer than the steps of so many rounds, and a whole part of `HELD_UP_NS`."""
SLOW_NS = 1_500_000
"""What a sample costs a computer that cannot keep up with 1 kHz."""


def stalled(world: World, to_ns: int) -> None:
    """Let time pass for devices whose process does not run in the first part of each EVERY_NS."""
    while world.now_ns < to_ns:
        world.now_ns = min(to_ns, world.now_ns + STEP_MAX_NS)
        if world.now_ns % EVERY_NS >= STALL_NS:
            world._step()


@contextmanager
def enabled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[tuple[VirtualService, World, str, list[int]]]:
    """Yield a bench that is enabled, its world, its token, and a list of the ages of feedback."""
    config = shipped(tmp_path, EMULATED)
    plays_on = config.bench.model_copy(update={"rig_patience_s": None})
    config = config.model_copy(update={"bench": plays_on})
    ages_ns: list[int] = []
    with on_the_wire(config, tmp_path) as (service, loop):
        world, port = loop.world, loop.world.emulator._can
        fast = {message.name for message in world.emulator._fast}
        send = port.send

        def noting(codec, values, at_ns):
            if codec.name in fast:
                ages_ns.append(world.now_ns - at_ns)
            send(codec, values, at_ns)

        monkeypatch.setattr(port, "send", noting)
        yield service, world, service.enabled(), ages_ns


def test_an_emulator_that_stalls_sends_no_old_feedback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with enabled(tmp_path, monkeypatch) as (service, world, token, ages_ns):
        monkeypatch.setattr(World, "advance", stalled)
        service.ask("set", token=token, torque_Nm=TORQUE_NM)
        service.run_s(1.0, token)
        emulator = world.emulator
        assert service.bench.state is State.ENABLED, service.messages()
    assert max(ages_ns) < 1_000_000
    stalls = 1_000_000_000 // EVERY_NS
    assert emulator.summary()["feedback_late"] > stalls * (STALL_NS // 1_000_000 - 2)


def test_an_emulator_that_is_preempted_while_it_sends_sends_no_old_feedback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with enabled(tmp_path, monkeypatch) as (service, world, token, ages_ns):
        sample, sampled = world.emulator._link.sample, count(1)

        def preempted(*arguments):
            sample(*arguments)
            if next(sampled) % PREEMPTED_EVERY == 0:
                world.now_ns += PREEMPTED_NS

        monkeypatch.setattr(world.emulator._link, "sample", preempted)
        service.ask("set", token=token, torque_Nm=TORQUE_NM)
        service.run_s(1.0, token)
        emulator = world.emulator
        assert service.bench.state is State.ENABLED, service.messages()
    assert max(ages_ns) < AGE_MAX_NS
    assert emulator.summary()["feedback_late"] >= 1000 // PREEMPTED_EVERY - 1


def test_an_emulator_that_is_always_late_is_not_silent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with enabled(tmp_path, monkeypatch) as (_, world, _, ages_ns):
        sample = world.emulator._link.sample

        def slowly(*arguments):
            sample(*arguments)
            world.now_ns += SLOW_NS

        monkeypatch.setattr(world.emulator._link, "sample", slowly)
        ages_ns.clear()
        began_ns = world.now_ns
        while world.now_ns - began_ns < 10 * SILENCE_MAX_NS:
            world.now_ns += STEP_MAX_NS
            world._step()
    assert sum(age_ns >= AGE_MAX_NS for age_ns in ages_ns) >= 3


def test_an_emulator_that_is_preempted_before_it_sends_listens_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Or a drive that the host has disabled meanwhile would say that it is on, as of now."""
    with enabled(tmp_path, monkeypatch) as (service, world, *_):
        emulator, stated = world.emulator, []
        sample, send = emulator._link.sample, emulator._can.send

        def preempted(*arguments):
            sample(*arguments)
            monkeypatch.setattr(emulator._link, "sample", sample)
            monkeypatch.setattr(emulator._can, "send", stating)
            service.loop.rig.safe_stop()
            world.now_ns += HELD_UP_NS

        def stating(codec, values, at_ns):
            stated.append(int(values["status"]) & emulator._codec.status_word(InverterStatus.READY))
            send(codec, values, at_ns)

        monkeypatch.setattr(emulator._link, "sample", preempted)
        while not stated:
            world.now_ns += STEP_MAX_NS
            world._step()
    assert set(stated) == {0}


def test_messages_without_currents_leave_however_late_their_emulator_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are due at every tenth instant, and of each round the last one alone leaves."""
    with enabled(tmp_path, monkeypatch) as (service, world, *_):
        emulator, sent = world.emulator, []
        sense, send, began_ns = emulator.bench.sense, emulator._can.send, 0

        def held_up():
            if world.now_ns == began_ns:  # the first time in a round
                service.loop.rig.safe_stop()
                world.now_ns += HELD_UP_NS
            return sense()

        def noting(codec, values, at_ns):
            sent.append(codec)
            send(codec, values, at_ns)

        while emulator._slow_feedback.next_ns - world.now_ns > SLOW_PERIOD_NS * 0.8:
            world.advance(world.now_ns + STEP_MAX_NS)
        monkeypatch.setattr(emulator.bench, "sense", held_up)
        monkeypatch.setattr(emulator._can, "send", noting)
        for turn in range(3 + ROUNDS):
            if turn == 3:  # it is off
                sent.clear()
            world.now_ns += STEP_MAX_NS
            began_ns = world.now_ns
            world._step()
    for codec in (*emulator._fast, *emulator._slow):
        assert sent.count(codec) >= ROUNDS - 1


def test_a_drive_that_is_off_says_so_however_late_its_emulator_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each of its rounds takes so long that another command to be off has come meanwhile."""
    with enabled(tmp_path, monkeypatch) as (service, world, _, ages_ns):
        bench = world.emulator.bench
        sense, began_ns = bench.sense, 0

        def held_up():
            if world.now_ns == began_ns:  # the first time in a round
                service.loop.rig.safe_stop()
                world.now_ns += HELD_UP_NS
            return sense()

        monkeypatch.setattr(bench, "sense", held_up)
        for turn in range(13):
            if turn == 3:  # it is off
                ages_ns.clear()
            world.now_ns += STEP_MAX_NS
            began_ns = world.now_ns
            world._step()
    assert len(ages_ns) >= 9
