"""The unit files that are shipped: systemd finds nothing wrong, and they are well shut."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

UNIT = Path(__file__).parents[3] / "systemd" / "motord.service"
EXPOSURE_MAX = 2.5

if shutil.which("systemd-analyze") is None:
    pytest.skip("needs systemd-analyze: apt install systemd", allow_module_level=True)


def analyse(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["systemd-analyze", *arguments, str(UNIT)], capture_output=True, text=True, check=False
    )


def test_systemd_finds_nothing_wrong() -> None:
    found = analyse("verify")
    assert (found.returncode, found.stdout, found.stderr) == (0, "", "")


def test_systemd_finds_nothing_wrong_with_the_archive(tmp_path: Path) -> None:
    folder = tmp_path / "archive"
    folder.mkdir()
    unit = UNIT.with_name("motord-archive@.service")
    escaped = str(folder).strip("/").replace("-", r"\x2d").replace("/", "-")
    instance = tmp_path / f"motord-archive@{escaped}.service"
    instance.write_text(unit.read_text())
    found = subprocess.run(
        ["systemd-analyze", "verify", str(instance)], capture_output=True, text=True, check=False
    )
    assert (found.returncode, found.stdout, found.stderr) == (0, "", "")


def test_little_is_exposed() -> None:
    found = analyse("security", "--offline=true", "--no-pager")
    level = re.search(r"Overall exposure level for motord.service: ([0-9.]+)", found.stdout)
    assert level, found.stdout + found.stderr
    assert 0.0 < float(level.group(1)) <= EXPOSURE_MAX


def test_what_the_loop_asks_for_is_let_through() -> None:
    """Rights of `loop.rt_setup` and `service.host.scheduling` that a closed unit could take."""
    unit = UNIT.read_text()
    rules = UNIT.with_name("60-motord.rules").read_text()
    assert "DeviceAllow=/dev/cpu_dma_latency rw" in unit
    assert 'KERNEL=="cpu_dma_latency"' in rules
    for call in ("mlockall", "sched_setscheduler", "sched_setaffinity", "setpriority"):
        assert re.search(rf"^SystemCallFilter=(?!~).*\b{call}\b", unit, re.MULTILINE), call
    assert re.search(r"^SystemCallFilter=@chown ", unit, re.MULTILINE)  # after ~@privileged
    for right in ("LimitRTPRIO=98", "LimitMEMLOCK=infinity", "RestrictRealtime=no"):
        assert right in unit


def test_serial_ports_that_are_connected_later_are_let_through() -> None:
    """systemd.resource-control(5): of the groups that DeviceAllow= names, those that are known."""
    unit = UNIT.read_text()
    for group, module in (("ttyACM", "cdc_acm"), ("ttyUSB", "usbserial")):
        assert f"DeviceAllow=char-{group} rw" in unit
        for key in ("Wants", "After"):
            assert re.search(rf"^{key}=.*\bmodprobe@{module}\.service\b", unit, re.MULTILINE)


def test_it_comes_back_but_never_enabled() -> None:
    unit = UNIT.read_text()
    assert "Restart=on-failure" in unit
    assert "Type=notify" in unit
    assert re.search(r"^WatchdogSec=\d+$", unit, re.MULTILINE)
    assert "enable" not in re.findall(r"^ExecStart.*$", unit, re.MULTILINE)[0]


def test_the_ring_of_a_daemon_that_was_killed_outlives_it() -> None:
    assert re.search(r"^RuntimeDirectoryPreserve=yes$", UNIT.read_text(), re.MULTILINE)


def test_its_group_reaches_the_socket_and_nobody_else_does() -> None:
    unit = UNIT.read_text()
    for line in ("Group=motord", "RuntimeDirectory=motord", "RuntimeDirectoryMode=0750"):
        assert re.search(rf"^{line}$", unit, re.MULTILINE), line
    service = (UNIT.parents[1] / "docs" / "service.md").read_text()
    [path] = set(re.findall(r"unixsock-stream/(/run/motord/[\w.]+)", service))
    [runtime] = re.findall(r"^Environment=.*XDG_RUNTIME_DIR=(\S+)", unit, re.MULTILINE)
    assert Path(path).parent == Path(runtime)
