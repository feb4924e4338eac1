"""A child process with pipes that the test plays."""

import json
import os

from motord.recorder.pipe_lines import LineReader


class PlayedProcess:
    """Ends when it is sent a signal; `code` then says by which."""

    def __init__(self):
        commands, into = os.pipe()
        out_of, self.reports = os.pipe()
        self.stdin, self.stdout = os.fdopen(into, "wb", 0), os.fdopen(out_of, "rb", 0)
        os.set_blocking(commands, False)
        self._commands = LineReader(commands)
        self.code, self.pid, self.open = None, 4711, [commands, self.reports]

    def poll(self):
        return self.code

    def send_signal(self, sig):
        self.code = -sig

    def say(self, line):
        os.write(self.reports, line + b"\n")

    def received(self):
        return [json.loads(line) for line in self._commands.read()]

    def close(self):
        for end in self.open:
            os.close(end)
