"""The process that reads the slow channels, with a thread for each line: a port, a bus, a driver.

`python -m motord.service.channels.process --config FILE --dir RUNDIR`: readings go as lines of JSON
to stdout (`protocol`); it ends with stdin. A source that hangs holds up its own line only. Ages,
limits and trips are the supervisor's: nothing that happens here makes a channel look younger.
"""

import os
import select
import sys
import threading
from contextlib import suppress
from functools import partial
from queue import Empty, SimpleQueue

from motord.config import Config
from motord.hal.channel_source import ChannelReading
from motord.hal.channels.line_poller import LinePoller
from motord.hal.channels.registry import make_lines
from motord.process.ending_threads import start_thread
from motord.recorder.pipe_lines import LineWriter
from motord.recorder.ring_source import RingSource
from motord.recording.json_encoding import to_line
from motord.service.channels.protocol import READINGS_MAX, ReadingMessage, ReadingsMessage
from motord.service.host import background, scheduling
from motord.shm.run_directory import RunDir

SEND_S = 0.05
"""Time between two messages while there are readings."""
ALIVE_S = 1.0
"""Time between two messages without any."""


def follow(line: LinePoller) -> None:
    """Read the channels of a line for ever."""
    waiting = threading.Event()
    while True:
        waiting.wait(line.step())


def send(readings: "SimpleQueue[ChannelReading]", out: LineWriter, stdin: int) -> None:
    """Pass readings on until `stdin` ends; while nobody takes them there are no new messages."""
    quiet_s = ALIVE_S
    while True:
        if select.select([stdin], [], [], SEND_S)[0] and not os.read(stdin, 1 << 12):
            return
        out.flush()
        while readings.qsize() > READINGS_MAX:  # nobody takes them: only the newest matter
            readings.get()
        quiet_s += SEND_S
        if out.waiting or (readings.empty() and quiet_s < ALIVE_S):
            continue
        quiet_s = 0.0
        found: list[ReadingMessage] = []
        with suppress(Empty):
            while len(found) < READINGS_MAX:
                found.append(ReadingMessage.of(readings.get_nowait()))
        out.write(to_line(ReadingsMessage(readings=tuple(found)).model_dump()))


def serve(config: Config, run_dir: RunDir, out: LineWriter) -> None:
    """Read the channels of a bench until stdin ends."""
    ticks = RingSource(run_dir.ring, "now", at_once=1 << 16)
    readings: SimpleQueue[ChannelReading] = SimpleQueue()
    for sources in make_lines(config, lambda: ticks.read().block):
        line = LinePoller(sources, readings.put)
        name = sources[0][0].name
        start_thread(partial(follow, line), name)
    send(readings, out, sys.stdin.fileno())


if __name__ == "__main__":
    code = background.run("channels", serve, schedule=scheduling.avoid_cpu, blocking=False)
    sys.stderr.flush()
    os._exit(code)  # a driver that hangs must not keep the process
