"""What happens to the unit under systemd: start, a loop that stops, stop. Leaves facts.json.

Runs as root next to systemd as PID 1 (`manager.sh`), by files of Python's and motord's own alone.
"""

import fcntl
import json
import os
import signal
import socket
import struct
import subprocess
import time
from pathlib import Path

from motord import config
from motord.client import connect

UNIT = "motord.service"
SHOWN = (
    "ActiveState", "SubState", "Result", "NRestarts", "MainPID", "ExecMainStatus", "User", "Job",
)  # fmt: skip
OUT = Path("/run/out/facts.json")
PATIENCE_S = 120.0


def systemctl(*arguments: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(["systemctl", *arguments], capture_output=True, text=True, check=False)


def shown() -> dict[str, str]:
    lines = systemctl("show", UNIT, f"--property={','.join(SHOWN)}").stdout.splitlines()
    return dict(line.split("=", 1) for line in lines)


def loopback_up() -> None:
    """Do as `ip link set lo up`."""
    with socket.socket() as any_socket:
        up = struct.pack("16sh", b"lo", 0x1 | 0x40)  # IFF_UP, IFF_RUNNING
        fcntl.ioctl(any_socket, 0x8914, up)  # SIOCSIFFLAGS


def processes() -> dict[int, str]:
    """Return the unit's processes and their command lines."""
    group = systemctl("show", UNIT, "--property=ControlGroup", "--value").stdout.strip()
    try:
        pids = Path(f"/sys/fs/cgroup{group}/cgroup.procs").read_text().split() if group else []
    except FileNotFoundError:
        return {}
    found = {}
    for pid in map(int, pids):
        try:
            found[pid] = Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
        except (FileNotFoundError, ProcessLookupError):
            continue
    return found


def loop_of(found: dict[int, str]) -> int:
    [pid] = [pid for pid, command in found.items() if " motord.loop.main " in command]
    return pid


def motord(*arguments: str) -> "subprocess.CompletedProcess[str]":
    command = ["/opt/motord/bin/motord", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def main() -> None:
    loopback_up()
    bench = config.load(Path("/etc/motord/bench.toml"))
    endpoint = bench.zenoh.listen[0]
    facts: dict[str, object] = {}

    def state() -> str:
        with connect(bench.bench.name, endpoint) as client:
            return str(client.state().state)

    facts["start"] = systemctl("start", UNIT).returncode
    facts["started"] = shown()
    if facts["start"] == 0:
        facts["state"] = state()
        facts["status"] = json.loads(motord("service", "status", "--json").stdout)
        facts["uid"] = Path(f"/proc/{shown()['MainPID']}").stat().st_uid
        with connect(bench.bench.name, endpoint) as client, client.lease("scenario") as lease:
            facts["enabled"] = client.rpc("enable", token=lease.token)["state"]
            os.kill(loop_of(processes()), signal.SIGSTOP)
        deadline_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline_s:
            now = shown()
            if now["NRestarts"] != "0" and now["ActiveState"] == "active":
                facts["state again"] = state()
                break
            waits = now.get("Job", "0") not in ("", "0")  # for what is to be started before it
            if now["ActiveState"] in ("failed", "inactive") and not waits:
                break
            time.sleep(1.0)  # a look costs systemd and systemctl more than the bench meanwhile
        facts["restarted"] = shown()
        facts["stop"] = systemctl("stop", UNIT).returncode
    facts["stopped"] = shown()
    deadline_s = time.monotonic() + PATIENCE_S
    while processes() and time.monotonic() < deadline_s:  # what was killed may be about to end
        time.sleep(0.1)
    facts["left"] = list(processes().values())
    removed = motord("service", "uninstall")
    facts["uninstall"] = [removed.returncode, removed.stdout + removed.stderr]
    facts["unit left"] = systemctl("show", UNIT, "--property=LoadState", "--value").stdout.strip()
    facts["bench left"] = Path("/etc/motord/bench.toml").exists()
    facts["kernels"] = sorted(p.name for p in Path("/var/cache/motord").glob("*/kernels-*"))
    facts["recordings"] = sorted(p.name for p in Path("/var/lib/motord").rglob("*.mcap*"))
    OUT.write_text(json.dumps(facts))


if __name__ == "__main__":
    main()
