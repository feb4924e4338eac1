"""What may go wrong around a running bench: a subscriber that stands still, hogs, a full disk."""

import os
import resource
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

STEP_S = 60.0
_ESTABLISHED = "01"

SUBSCRIBER = """
import sys, threading, zenoh
from motord.api.endpoints import client_config, key
config = client_config(sys.argv[2])
config.insert_json5("transport/link/tcp/so_rcvbuf", "16384")
came = threading.Event()
with zenoh.open(config) as session:
    session.declare_subscriber(key(sys.argv[1], "**"), lambda sample: came.set())
    assert came.wait(60)
    print("up", flush=True)
    threading.Event().wait()
"""
"""Takes all that a bench publishes, and has little room for what it has not read."""


@contextmanager
def subscriber(bench, endpoint):
    """Subscribe to all of a bench's telemetry in a process of its own; yields the process."""
    command = [sys.executable, "-c", SUBSCRIBER, bench, endpoint]
    process = subprocess.Popen(command, stdout=subprocess.PIPE)
    try:
        assert process.stdout.readline() == b"up\n"
        yield process
    finally:
        process.kill()
        process.communicate()


def unsent_bytes(endpoint):
    """Return how much lies in the sockets behind `endpoint` that the other ends do not take."""
    port = int(endpoint.rpartition(":")[2])
    unsent = 0
    for line in Path("/proc/net/tcp").read_text().splitlines()[1:]:
        _, local, _, state, queues, *_ = line.split()
        if state == _ESTABLISHED and int(local.partition(":")[2], 16) == port:
            unsent += int(queues.partition(":")[0], 16)
    return unsent


@contextmanager
def hogs():
    """Keep every processor busy at normal priority; yields the processes."""
    command = [sys.executable, "-c", "while True: pass"]
    processes = []
    try:
        for cpu in sorted(os.sched_getaffinity(0)):
            processes.append(subprocess.Popen(command))
            os.sched_setaffinity(processes[-1].pid, {cpu})
        yield processes
    finally:
        for process in processes:
            process.kill()
            process.wait()


def signal_all(processes, number: signal.Signals):
    """Send all processes a signal."""
    for process in processes:
        process.send_signal(number)


def small_disk(folder: Path, size_MB: int):
    """Return a command before another that makes `folder` a disk of its own, for it alone."""
    script = f'mount -t tmpfs -o size={size_MB}m motord "$0" && exec "$@"'
    return (*_unshare(), "sh", "-c", script, str(folder))


def small_disks_can_be_had():
    """Return whether this user may mount, in a namespace of the process's own."""
    try:
        probe = [*_unshare(), "sh", "-c", "mount -t tmpfs motord /mnt"]
        return subprocess.run(probe, capture_output=True, timeout=STEP_S).returncode == 0
    except FileNotFoundError:
        return False


def _unshare():
    return ("unshare", "--mount") if os.getuid() == 0 else ("unshare", "--map-root-user", "--mount")


def seen_by(process, path: Path):
    """Return `path` as `process` sees it."""
    return Path(f"/proc/{process.pid}/root{path}")


def let_files_grow_no_more(pid, bytes_max):
    """Let process `pid` write no file beyond `bytes_max`, as a full disk would."""
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (bytes_max, bytes_max))
