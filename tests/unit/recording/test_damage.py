"""What is missing of a recording, in words: stretches of time in order, each once, not too many."""

import re

import pytest
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema
from typer.testing import CliRunner

from motord.cli.record.commands import app
from motord.recording.damage import GAP_NS, LINES_MAX, Damage, Loss, damage_of
from motord.recording.mcap.records import RECORD_HEAD, parse, serialise
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from tests.unit.recording.runs import METADATA, START_NS, tick_block, truth_block

SECOND_NS = 10**9


def loss(number: int, begin_s: float, end_s: float, reason: str = "not readable") -> Loss:
    begin_ns, end_ns = (START_NS + round(s * SECOND_NS) for s in (begin_s, end_s))
    return Loss(100 * number, 10, reason, begin_ns, end_ns)


def damage(*losses: Loss) -> Damage:
    found = damage_of(losses)
    assert found is not None
    return found


def seconds(line: str) -> list[str]:
    return re.findall(r":(\d\d\.\d{3})Z", line)


def test_losses_of_one_stretch_are_one_line():
    ticks, truth, later = loss(1, 1, 2), loss(2, 0.5, 1.5, "cut"), loss(3, 2.001, 3)
    [line] = damage(ticks, truth, later).lines()
    assert line.startswith("30 bytes in 3 parts from byte 100 on: cut, not readable; ")
    assert seconds(line) == ["20.500", "23.000"]


@pytest.mark.parametrize(("gap_ns", "lines"), [(GAP_NS, 1), (GAP_NS + 1, 2)])
def test_what_was_read_between_two_losses_makes_two_lines_of_them(gap_ns, lines):
    first = loss(1, 0, 1)
    second = Loss(200, 10, "x", first.to_ns + gap_ns, first.to_ns + SECOND_NS)
    assert len(damage(first, second).lines()) == lines


def test_a_loss_within_another_does_not_end_it():
    assert len(damage(loss(1, 0, 9), loss(2, 1, 2), loss(3, 5, 6)).lines()) == 1


def test_open_ends_stay_open():
    start, end = Loss(1, 1, "x", None, START_NS), Loss(9, 1, "y", START_NS + 5 * SECOND_NS)
    index = Loss(0, 0, "the index", messages=False)
    lines = damage(index, end, start, loss(20, 5.5, 6)).lines()
    assert ["before" in lines[0], "anything after" in lines[1]] == [True, True]
    assert lines[2] == "the index; no messages are missing"


@pytest.mark.parametrize(("count", "shown", "on_a_line"), [(3, 3, 3), (12, 12, 4), (40, 13, 4)])
def test_many_are_counted_not_listed(count, shown, on_a_line):
    found = damage(*(loss(n, 2 * n, 2 * n + 1) for n in range(count)))
    assert len(found.lines()) == shown
    parts = str(found).split("; and ")
    assert sum(part.count(" from byte ") for part in parts) == min(on_a_line, 3)
    if shown > 12:
        assert found.lines()[-1] == f"and {count - 12} more, {10 * count} bytes in all"
    if count > 3:
        assert parts[-1] == f"{count - 3} more, {10 * count} bytes in all"


def test_reasons_are_counted_too():
    [line] = damage(*(loss(n, n, n + 1, f"reason {n}") for n in range(5))).lines()
    assert ": reason 0, reason 1, 3 other reasons; " in line


@pytest.fixture
def riddled(tmp_path):
    """A closed recording, whose index is whole, with every third chunk damaged.

    Its chunks overlap: the truth comes later than the ticks.
    """
    path = tmp_path / "run.mcap"
    ticks, truth = tick_block(3000), truth_block(3000)
    with RunWriter(path, METADATA) as writer:
        for start in range(50, 3000, 50):
            writer.ticks(ticks[start : start + 50])
            writer.flush()
            writer.truth(truth[start - 50 : start])
            writer.flush()
    content = bytearray(path.read_bytes())
    for chunk in open_run(path).source.structure.chunks[::3]:
        content[chunk.offset + chunk.size // 2] ^= 0xFF
    path.write_bytes(content)
    return path


def test_times_of_a_chunk_that_the_index_knows_are_its_own(riddled):
    run = open_run(riddled)
    found, chunks = run.check(), run.source.structure.chunks[::3]
    assert [(one.from_ns, one.to_ns) for one in found.losses] == [
        (chunk.start_ns, chunk.end_ns) for chunk in chunks
    ]


@pytest.mark.parametrize("closed", [True, False])
def test_no_loss_ends_before_it_begins(riddled, closed):
    if not closed:
        riddled.write_bytes(riddled.read_bytes()[:-40])
    found = open_run(riddled).check()
    spans = [(one.from_ns, one.to_ns) for one in found.losses if one.from_ns and one.to_ns]
    assert len(spans) > 10
    assert all(begin <= end for begin, end in spans)


def test_a_check_that_finds_damage_fails_and_lists_it(riddled):
    quick = CliRunner().invoke(app, ["info", str(riddled)])
    assert quick.exit_code == 0
    checked = CliRunner().invoke(app, ["info", str(riddled), "--check"])
    assert checked.exit_code == 1
    lines = checked.stdout.partition("missing: ")[2].splitlines()
    begins = [seconds(line) for line in lines[:LINES_MAX]]
    assert begins == sorted(begins)
    assert re.fullmatch(r" {18}and \d+ more, \d+ bytes in all", lines[LINES_MAX])
    assert "motord record recover" in checked.stderr
    recovered = CliRunner().invoke(app, ["recover", str(riddled)])
    assert recovered.exit_code == 0
    assert max(map(len, recovered.stdout.splitlines())) < 300


@pytest.mark.parametrize(
    ("opcode", "record"),
    [
        (Opcode.SCHEMA, Schema(1, b"fields", "protobuf", "motord.Tick")),
        (Opcode.CHANNEL, Channel(2, "/tick", "protobuf", {"unit": "Nm"}, 1)),
        (Opcode.METADATA, Metadata("motord", {"format": "1", "bench": "sim"})),
    ],
)
def test_a_record_that_is_too_short_or_too_long_is_damaged(opcode, record):
    body = serialise([record])[RECORD_HEAD.size :]
    assert parse(opcode, body) == record
    for wrong in (body + b"\0", *(body[:end] for end in range(len(body)))):
        with pytest.raises(ValueError):
            parse(opcode, wrong)
