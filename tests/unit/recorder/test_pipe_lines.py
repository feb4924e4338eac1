"""Lines and messages through pipes that are full, slow, or filled with nonsense."""

import contextlib
import json
import os
import random

import pytest

from motord.process.allowance import Allowance
from motord.recorder import pipe_lines
from motord.recorder.pipe_lines import LineReader, LineWriter
from motord.recorder.protocol import MessageReader, RecorderReport
from tests.support.nonsense import random_line


@pytest.fixture
def pipe():
    reader, writer = os.pipe()
    for end in (reader, writer):
        os.set_blocking(end, False)
    yield reader, writer
    for end in (reader, writer):
        with contextlib.suppress(OSError):  # the test has closed it
            os.close(end)


@pytest.mark.parametrize("seed", range(20))
def test_every_line_arrives_whole_and_in_order_or_is_counted_as_dropped(pipe, seed):
    chance = random.Random(seed)
    reader, writer = LineReader(pipe[0]), LineWriter(pipe[1], 150_000)
    sent, came = [], []
    for number in range(300):
        line = str(number).encode() + b"x" * chance.choice((1, 100, 5000, 70_000))
        sent.append(line)
        writer.write(line)
        if chance.random() < 0.4:
            came += reader.read()
    for _ in range(2000):
        writer.flush()
        came += reader.read()
    assert not writer.waiting
    assert set(came) <= set(sent)
    assert came == sorted(came, key=sent.index)
    assert len(came) + writer.dropped == len(sent)
    assert writer.dropped > 0


def test_a_line_that_has_begun_is_not_dropped(pipe):
    reader, writer = LineReader(pipe[0]), LineWriter(pipe[1], 100_000)
    first = b"a" * 90_000  # the pipe takes 65,536 of them
    writer.write(first)
    for _ in range(5):
        writer.write(b"b" * 60_000)
    came = []
    for _ in range(10):
        came += reader.read()
        writer.flush()
    assert came[0] == first
    assert writer.dropped == 5 - (len(came) - 1)


def test_a_line_longer_than_the_backlog_is_dropped_alone(pipe):
    reader, writer = LineReader(pipe[0]), LineWriter(pipe[1], 1000)
    writer.write(b"x" * 2000)
    writer.write(b"short")
    assert (reader.read(), writer.dropped) == ([b"short"], 1)


def test_nobody_who_reads_is_no_error(pipe):
    writer = LineWriter(pipe[1], 1000)
    os.close(pipe[0])
    writer.write(b"x")
    writer.write(b"y")
    assert not writer.waiting


def test_a_look_takes_a_bounded_part_of_what_has_come(pipe):
    reader = LineReader(pipe[0])
    os.write(pipe[1], b"\n" * 10_000)
    looks = []
    while came := reader.read():
        looks.append(len(came))
    assert sum(looks) == 10_000
    assert max(looks) == pipe_lines.LINES_AT_ONCE


def test_a_line_without_end_is_left_out_and_the_next_one_is_not(pipe):
    reader = LineReader(pipe[0], 100_000)
    for _ in range(50):
        os.write(pipe[1], b"x" * 50_000)
        assert reader.read() == []
        assert len(reader._rest) <= 100_000 + pipe_lines.READ_AT_ONCE_BYTES
    os.write(pipe[1], b"end\ngood\n")
    assert reader.read() == [b"good"]
    assert reader.overlong == 1


def test_a_descriptor_that_cannot_be_read_has_ended():
    reader, writer = os.pipe()
    os.close(reader)
    lines_of_none = LineReader(reader)
    assert lines_of_none.read() == []
    assert lines_of_none.ended
    os.close(writer)


@pytest.mark.parametrize(
    "report",
    [
        {"recording": True, "ticks": -1},
        {"recording": True, "ticks": True},
        {"recording": True, "ticks": 1e3},
        {"recording": True, "ticks": 1 << 63},
        {"recording": 1},
        {"recording": True, "error": "x" * 20_000},
        {"recording": True, "error": ["x"]},
        {"recording": True, "blackboxes": []},
        {"recording": True, "blackboxes": {"x": 1}},
        {"recording": True, "blackboxes": {str(n): "" for n in range(100)}},
        {"recording": True, "unheard": 1},
        {},
        [],
        None,
    ],
)
def test_right_json_of_wrong_types_is_no_report(pipe, report):
    received = MessageReader(pipe[0], RecorderReport)
    os.write(pipe[1], json.dumps(report).encode() + b"\n")
    assert received.read(0) == []
    assert received.bad == 1


def test_10_000_random_lines_are_counted_and_none_is_taken_for_a_report(pipe):
    chance, received, bad, looks = random.Random(7), MessageReader(pipe[0], RecorderReport), 0, 0
    good = b'{"recording":true,"ticks":'
    came = []
    for number in range(10_000):
        line = random_line(chance)
        bad += line.count(b"\n") + 1
        os.write(pipe[1], line + b"\n" + good + str(number).encode() + b"}\n")
        while reports := received.read(0):
            came += [report.ticks for report in reports]
            looks += 1
    assert came == list(range(10_000))
    assert received.bad == bad
    assert received.flooded


def test_what_may_come_for_ever_and_at_once():
    allowance = Allowance(rate_per_s=10.0, burst=100.0)
    assert allowance.spend(100.0, 0)
    assert not allowance.spend(1.0, 0)
    allowance = Allowance(rate_per_s=10.0, burst=100.0)
    assert all(allowance.spend(1.0, n * 100_000_000) for n in range(10_000))
    assert not all(allowance.spend(1.1, n * 100_000_000) for n in range(10_000, 12_000))
