"""Standard streams that were closed before the start, as `motord ... <&- >&- 2>&-` does."""

import subprocess
import sys

SHELL = 'exec "$0" -c "$1" "$2" 3>&1 <&- >&- 2>&-'
PROGRAM = """
import os, subprocess, sys
from motord.process.standard_streams import outlive_readers

outlive_readers()
print(sys.stdin.read() + "nobody reads this", sys.stdin.isatty(), file=sys.stderr, flush=True)
os.write(3, b"%d\\n" % os.open("/", os.O_RDONLY))
subprocess.run([sys.executable, "-S", "-c", sys.argv[1]], pass_fds=[3])
"""
CHILD = "import os; os.write(3, b' '.join(os.readlink(b'/proc/self/fd/%d' % n) for n in range(3)))"


def test_closed_streams_lead_nowhere_and_no_file_takes_their_place() -> None:
    command = ["sh", "-c", SHELL, sys.executable, PROGRAM, CHILD]
    shown = subprocess.run(command, capture_output=True, text=True).stdout
    opened, _, of_child = shown.partition("\n")
    assert int(opened) > 2
    assert of_child.split() == ["/dev/null"] * 3
