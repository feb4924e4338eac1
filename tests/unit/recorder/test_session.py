"""The recorder's session without its process: a ring in, files out."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.recorder.commands import handle
from motord.recorder.protocol import Mark
from motord.recorder.ring_source import last_mark
from motord.recording.errors import RecordError
from motord.recording.file_names import file_name, next_file, numbers
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from motord.shm.ring import RingWriter
from tests.unit.recorder.recorder_bench import CAPACITY, Bench
from tests.unit.recording.runs import METADATA, PERIOD_NS, START_NS, point_of, same, tick_block

pytestmark = pytest.mark.usefixtures("free_space")


def test_ticks_from_the_start_on_are_recorded_once(bench):
    bench.loop(20)
    bench.start()
    for _ in range(10):
        bench.loop(50)
        bench.step()
    bench.loop(30)
    bench.stop()
    bench.loop(30)
    bench.step()
    assert bench.recorded() == list(range(20, 550))
    assert [f.name for f in bench.files()] == ["day-000.mcap"]
    run = open_run(bench.files()[0])
    assert run.metadata == {"format": "1", **METADATA, "recording": "day", "file": 0}
    assert run.end["reason"] == "done"
    report = bench.report()
    assert report == {
        "recording": False, "file": str(bench.files()[0]), "path": str(bench.files()[0]),
        "files": 1, "ticks": 530,
        "bytes": bench.files()[0].stat().st_size, "lost": 0, "error": "",
        "closed": [str(bench.stem)],
    }  # fmt: skip
    block = np.concatenate(list(run.blocks()))
    expected = tick_block(530, 20)
    assert block["tick"].tolist() == expected["tick"].tolist()
    assert bench.session.over


def test_a_point_comes_after_its_ticks_so_that_a_file_cut_off_has_both_or_neither(bench):
    bench.start()
    for last in (40, 90):
        bench.loop(50)
        content = point_of(tick_block(last + 1))
        bench.do(do="operating_point", t_ns=START_NS, content=content)
    bench.stop()
    [file] = bench.files()
    content = file.read_bytes()
    for size in range(0, len(content), 97):
        cut = bench.folder / "cut.mcap"
        cut.write_bytes(content[:size])
        try:
            run = open_run(cut)
            points, ticks = run.operating_points(), run.ticks(["tick"])["tick"]
        except RecordError:
            continue
        for point in points:
            assert set(range(point["tick_end"] + 1)) <= set(ticks.tolist())
    assert [p["tick_end"] for p in open_run(file).operating_points()] == [40, 90]


@given(
    st.lists(
        st.sampled_from(["loop 1", "loop 70", "loop 200", "step", "late step", "restart"]),
        max_size=25,
    )
)
@settings(max_examples=60)
def test_whatever_happens_every_tick_is_in_the_files_once_or_counted(tmp_path_factory, actions):
    bench = Bench(tmp_path_factory.mktemp("bench"), file_max_s=0.3)
    bench.start()
    bench.loop(1)
    bench.step(1.1)  # so that there is a file to go on from
    for action in actions:
        if action.startswith("loop"):
            bench.loop(int(action.split()[1]))
        elif action == "restart":  # as if killed: nothing is closed
            bench.session = bench.new_session()
            bench.start(resume=True)
        else:
            bench.step(1.1 if action == "late step" else 0.05)
    bench.stop()
    recorded = bench.recorded()
    assert recorded == sorted(set(recorded))
    missing = set(range(bench.published)) - set(recorded)
    reported = [e["data"]["lost"] for e in bench.events() if e["kind"] == "ring_lost"]
    assert sum(reported) == len(missing)
    if "restart" not in actions:
        assert bench.report()["lost"] == len(missing)


def test_overwritten_ticks_are_counted_and_reported(bench):
    bench.start()
    bench.loop(10)
    bench.step()
    bench.loop(CAPACITY + 100)
    bench.step()
    bench.stop()
    recorded = bench.recorded()
    missing = sorted(set(range(bench.published)) - set(recorded))
    assert missing == list(range(10, 10 + len(missing)))
    assert len(missing) >= 100
    event = next(e for e in bench.events() if e["kind"] == "ring_lost")
    assert event["data"] == {"lost": len(missing), "tick_after": 10 + len(missing)}
    assert event["message"].startswith(f"{len(missing)} ticks were overwritten")
    assert event["t_ns"] == START_NS + (10 + len(missing)) * PERIOD_NS
    assert bench.report()["lost"] == len(missing)


def test_messages_are_recorded_and_forgotten_without_a_recording(bench):
    bench.do(do="event", t_ns=1, content={"kind": "early", "message": "not recorded"})
    bench.do(do="plan", t_ns=1, content={})
    bench.do(do="operating_point", t_ns=1, content={})
    point = point_of(tick_block(5))
    bench.start()
    bench.loop(5)
    bench.do(do="event", t_ns=2, content={"kind": "state", "message": "READY"})
    bench.do(do="event", t_ns=3, content={"kind": "state", "message": "X", "data": {"a": 1}})
    bench.do(do="plan", t_ns=4, content={"plan": "verify"})
    bench.do(do="operating_point", t_ns=5, content=point)
    bench.stop()
    run = open_run(bench.files()[0])
    assert [(e["t_ns"], e["kind"], e["data"]) for e in run.events()] == [
        (2, "state", {}), (3, "state", {"a": 1}),
    ]  # fmt: skip
    assert run.plan() == [{"t_ns": 4, "plan": "verify"}]
    assert run.operating_points() == [{"t_ns": 5, **point}]


@pytest.mark.parametrize(
    "line",
    [b"", b"{", b"7", b"[]", b'{"do":"dance"}', b'{"do":"start"}', b'{"do":"start","out":5}',
     b'{"do":"event","t_ns":1}', b'{"do":"plan","t_ns":1,"content":[]}',
     b'{"do":"plan","t_ns":10000000000000000000,"content":{}}',
     b'{"do":"operating_point","t_ns":null,"content":{}}', b"\xff\xfe",
     b'{"do":"start","out":"x","metadata":5}'],
)  # fmt: skip
def test_a_command_that_makes_no_sense_is_reported_and_harms_nothing(bench, line):
    bench.start()
    bench.loop(5)
    if b"metadata" not in line:
        handle(bench.session, line, bench.now_s)
        bench.do(do="event", t_ns="x", content={"kind": "k", "message": "m"})
        assert "command not understood" in bench.report()["error"]
        assert bench.report()["recording"]
        bench.stop()
        assert bench.recorded() == list(range(5))


def test_a_new_start_ends_the_recording_and_loses_nothing_between(bench):
    bench.start()
    bench.loop(40)
    bench.step()
    bench.loop(40)
    bench.start()
    bench.loop(40)
    bench.stop()
    assert [f.name for f in bench.files()] == ["day-000.mcap", "day-001.mcap"]
    assert bench.recorded() == list(range(120))
    assert len(open_run(bench.files()[0]).ticks()) == 80
    assert open_run(bench.files()[0]).end["reason"] == "the recording day began"


def test_a_new_file_by_time(tmp_path):
    bench = Bench(tmp_path, file_max_s=0.2)
    bench.start()
    for _ in range(10):
        bench.loop(50)
        bench.step()
    bench.stop()
    assert [f.name for f in bench.files()] == ["day-000.mcap", "day-001.mcap"]
    assert [len(open_run(f).ticks()) for f in bench.files()] == [250, 250]
    assert [open_run(f).metadata["file"] for f in bench.files()] == [0, 1]
    assert bench.recorded() == list(range(500))
    assert open_run(bench.files()[0]).end["reason"].startswith("goes on in the next file")
    assert bench.report()["files"] == 2
    assert bench.report()["bytes"] == sum(f.stat().st_size for f in bench.files())


def test_a_new_file_by_size(tmp_path):
    bench = Bench(tmp_path, file_max_MB=0.02, chunk_s=0.01)
    bench.start()
    for _ in range(10):
        bench.loop(50)
        bench.step()
    bench.stop()
    assert len(bench.files()) > 2
    assert bench.recorded() == list(range(500))
    assert "after 0.02 MB" in open_run(bench.files()[0]).end["reason"]


def test_recordings_of_other_benches_next_to_it_do_not_matter(bench):
    bench.stem.parent.mkdir()
    with RunWriter(file_name(bench.stem.with_name("other"), 0), {}) as writer:
        writer.ticks(tick_block(10, 1000))
    (bench.stem.parent / "no-recording.mcap").write_bytes(b"")
    (bench.stem.parent / "broken-000.mcap").write_bytes(b"broken")
    bench.loop(20)
    bench.start(resume=True)
    bench.step()
    bench.stop()
    [day] = [f for f in bench.files() if f.name.startswith("day")]
    assert open_run(day).ticks(["tick"])["tick"].tolist() == list(range(20))


def test_names_of_files(tmp_path):
    stem = tmp_path / "day"
    assert numbers(tmp_path / "absent" / "day") == []
    assert next_file(stem) == tmp_path / "day-000.mcap"
    for name in ("day-000.mcap", "day-004.mcap.part", "day-x.mcap", "day-7.txt", "days-9.mcap"):
        (tmp_path / name).write_text("")
    assert numbers(stem) == [0, 4]
    assert next_file(stem) == tmp_path / "day-005.mcap"
    assert file_name(stem, 1234).name == "day-1234.mcap"


def test_the_last_tick_of_a_recording(tmp_path):
    stem = tmp_path / "day"
    assert last_mark(stem) is None
    block = tick_block(600)
    with RunWriter(file_name(stem, 0), {}, chunk_s=0.1) as writer:
        writer.ticks(block)
    RunWriter(file_name(stem, 1), {}).abandon()
    (tmp_path / "day-002.mcap.part").write_bytes(b"")
    expected = Mark(599, int(block["t_ns"][-1]), int(block["missed"][-1]))
    assert last_mark(stem) == expected
    content = bytearray(file_name(stem, 0).read_bytes())
    content[open_run(file_name(stem, 0)).source.structure.chunks[-1].offset + 200] ^= 1
    file_name(stem, 0).write_bytes(content)
    assert last_mark(stem).tick == 499
    assert same(open_run(file_name(stem, 0)).tick_table.last(), block[499:500])


def test_a_recording_begins_with_the_tick_that_is_asked_for(bench):
    bench.loop(100)
    bench.step()
    bench.start(first_tick=60)
    bench.loop(10)
    bench.step()
    bench.stop()
    assert bench.recorded() == list(range(60, 110))
    assert bench.report()["lost"] == 0
    assert not any(e["kind"] == "recorder_restarted" for e in bench.events())


def test_ticks_that_the_recording_before_has_are_not_recorded_twice(bench):
    bench.start()
    bench.loop(50)
    bench.step()
    bench.stop()
    bench.loop(10)
    for _ in range(2):  # by the same recorder, and by one that was started since
        bench.stem = bench.stem.with_name(f"{bench.stem.name}x")
        bench.start(first_tick=20)
        bench.loop(10)
        bench.step()
        bench.stop()
        bench.session = bench.new_session()
    assert sorted(bench.recorded()) == list(range(80))


def test_a_counter_that_began_anew_hides_no_tick(bench):
    bench.start()
    bench.loop(200)
    bench.step()
    bench.stop()
    bench.ring = RingWriter(bench.ring_path, CAPACITY)
    bench.loop(50, first=0)
    bench.stem = bench.stem.with_name("next")
    bench.start(first_tick=0)
    bench.step()
    bench.stop()
    assert bench.report()["ticks"] == 50


def test_ticks_before_the_first_that_the_ring_has_are_counted_as_lost(bench):
    bench.loop(CAPACITY + 100)
    bench.start(first_tick=50)
    bench.step()
    bench.stop()
    recorded = bench.recorded()
    assert recorded[-1] == CAPACITY + 99
    assert bench.report()["lost"] == recorded[0] - 50 > 0
