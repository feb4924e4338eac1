"""`motord service`: what it writes, what it leaves alone, what it removes again."""

import json
import re
import shutil
import stat
import subprocess
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from motord.cli import app
from motord.config import packaged
from motord.deployment import host
from motord.deployment import plan as plans

PROGRAM = "/usr/bin/env"
"""Stands for an installed motord: systemd-analyze wants to see it."""
WRITTEN = (
    "etc/systemd/system/motord.service",
    "etc/sysusers.d/motord.conf",
    "etc/udev/rules.d/60-motord.rules",
)
KEPT = ("etc/motord/bench.toml",)
CHANNELS = "".join(
    f"""
[[channels]]
name = "{name}"
unit = "degC"
source = {{driver = "modbus", host = "{host}", address = {address}}}
"""
    for address, (name, host) in enumerate(
        (("winding_C", "192.168.7.30"), ("housing_C", "192.168.7.30"), ("oil_C", "127.0.0.1"))
    )
)
"""Slow channels by Modbus TCP, two on another machine."""
LISTEN = 'listen = ["tcp/127.0.0.1:7447"]'
TLS = """listen = ["tcp/127.0.0.1:7447", "tls/0.0.0.0:7448"]
[zenoh.tls]
ca = "/home/anna/ca.pem"
certificate = "/etc/motord/access/server.pem"
key = "/etc/motord/access/server.key"
roles = "/etc/motord/access/roles.toml"
"""


def service(*arguments: object) -> Any:
    return CliRunner().invoke(app, ["service", *map(str, arguments)])


def install(folder: Path, *arguments: object, bench: str = "bench.toml") -> Any:
    where = ("-c", folder / bench, "--root", folder / "root", "--program", PROGRAM)
    return service("install", *where, *arguments)


def files(folder: Path) -> tuple[str, ...]:
    root = folder / "root"
    found = (str(path.relative_to(root)) for path in root.rglob("*") if path.is_file())
    return tuple(sorted(name for name in found if not name.endswith(".service.json")))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    text = packaged("examples/bench.toml").read_text()
    text = text.replace('"package:inverter.dbc"', '"dbc/mine.dbc"')
    (tmp_path / "bench.toml").write_text(text)
    (tmp_path / "dbc").mkdir()
    shutil.copy(packaged("inverter.dbc"), tmp_path / "dbc" / "mine.dbc")
    (tmp_path / "root").mkdir()
    return tmp_path


def test_it_writes_its_files_and_removes_these_alone(folder: Path) -> None:
    done = install(folder)
    assert done.exit_code == 0, done.output
    kept = (*KEPT, "etc/motord/dbc/mine.dbc")
    assert files(folder) == tuple(sorted((*WRITTEN, *kept)))
    runs = folder / "root" / "var" / "lib" / "motord" / "runs"
    runs.mkdir(parents=True)
    (runs / "a.mcap").write_text("recorded")
    other = folder / "root" / "etc" / "udev" / "rules.d" / "70-other.rules"
    other.write_text("")
    done = service("uninstall", "--root", folder / "root")
    assert done.exit_code == 0, done.output
    left = (*kept, "etc/udev/rules.d/70-other.rules", "var/lib/motord/runs/a.mcap")
    assert files(folder) == tuple(sorted(left))
    again = service("uninstall", "--root", folder / "root")
    assert again.exit_code == 1
    assert "there is no service" in again.stderr


def test_a_second_time_changes_nothing(folder: Path) -> None:
    install(folder)
    times = [(folder / "root" / name).stat().st_mtime_ns for name in WRITTEN]
    done = install(folder)
    assert done.exit_code == 0
    assert "every file was there" in done.stdout
    assert [(folder / "root" / name).stat().st_mtime_ns for name in WRITTEN] == times


def test_a_dry_run_shows_what_is_written_and_writes_nothing(folder: Path) -> None:
    done = install(folder, "--dry-run")
    assert done.exit_code == 0, done.output
    assert files(folder) == ()
    assert f"+ExecStart={PROGRAM} run --config /etc/motord/bench.toml" in done.stdout
    shown = json.loads(install(folder, "--dry-run", "--json").stdout)
    install(folder)
    for file in shown["files"]:
        assert file["difference"] == "new"
        assert (folder / "root" / file["path"][1:]).read_text() == file["text"]
    again = install(folder, "--dry-run")
    assert not re.search("^[+-]", again.stdout, re.M)
    removed = service("uninstall", "--root", folder / "root", "--dry-run", "--json")
    assert sorted(json.loads(removed.stdout)["removed"]) == [f"/{name}" for name in WRITTEN]
    assert WRITTEN[0] in files(folder)


def test_what_was_edited_is_not_written_over_or_removed(folder: Path) -> None:
    install(folder)
    rules = folder / "root" / "etc/udev/rules.d/60-motord.rules"
    mine = "gehört mir\n".encode("latin-1")
    rules.write_bytes(mine)
    rules.chmod(0o600)
    done = install(folder)
    assert done.exit_code == 1
    assert "60-motord.rules: there already, and not as installed" in done.stderr
    assert rules.read_bytes() == mine
    status = service("status", "--root", folder / "root")
    assert "60-motord.rules: edited" in status.stdout
    assert "motord.service: as installed" in status.stdout
    left = service("uninstall", "--root", folder / "root")
    assert f"left {rules}: it was edited" in left.stdout
    assert rules.exists()
    assert install(folder, "--force").exit_code == 0
    old = rules.with_name("60-motord.rules.old")
    assert (old.read_bytes(), stat.S_IMODE(old.stat().st_mode)) == (mine, 0o600)
    assert rules.read_text() == packaged("systemd/60-motord.rules").read_text()


def test_an_edited_bench_file_is_not_written_over(folder: Path) -> None:
    install(folder)
    there = folder / "root" / KEPT[0]
    there.write_text(there.read_text().replace("bench-1", "bench-2"))
    assert install(folder).exit_code == 1
    assert 'name = "bench-2"' in there.read_text()


def test_the_status_is_shown_whatever_became_of_the_bench_file(
    folder: Path, ran: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert service("install", "--user", "-c", folder / "bench.toml").exit_code == 0
    state = {"ActiveState": "failed", "SubState": "failed"}
    monkeypatch.setattr("motord.deployment.host.unit_state", lambda user: state)
    (folder / "bench.toml").write_text("[bench\n")
    done = service("status", "--user")
    assert done.exit_code == 1
    assert "failed (failed)" in done.stdout
    assert "motord service install" not in done.stdout
    assert f"motord: {folder}/bench.toml: not valid TOML" in done.stderr


def test_of_another_version(folder: Path) -> None:
    install(folder)
    manifest = folder / "root" / "etc/motord/.service.json"
    unit = folder / "root" / WRITTEN[0]
    unit.write_text("[Service]\n")
    content = json.loads(manifest.read_text())
    from motord.deployment.files import _hash

    content["files"]["/etc/systemd/system/motord.service"] = _hash("[Service]\n")
    manifest.write_text(json.dumps(content))
    assert (
        "motord.service: of another version" in service("status", "--root", folder / "root").stdout
    )
    assert install(folder).exit_code == 0
    assert "ExecStart=" in unit.read_text()


@pytest.mark.parametrize("manifest", ["", "[]", '{"files": 1}', '{"request": {}}'])
def test_a_damaged_manifest_is_named(folder: Path, manifest: str) -> None:
    install(folder)
    path = folder / "root" / "etc/motord/.service.json"
    path.write_text(manifest)
    for command in (["status"], ["uninstall"]):
        done = service(*command, "--root", folder / "root")
        assert (done.exit_code, done.stdout) == (1, "")
        assert f"{path}: not a list of installed files" in done.stderr


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (('"dbc/mine.dbc"', '"../mine.dbc"'), "outside of its folder"),
        (('"dbc/mine.dbc"', '"/home/anna/mine.dbc"'), "in a home, which the service cannot see"),
        (('directory = "runs"', 'directory = "/home/anna/runs"'), "put it below /srv"),
        ((LISTEN, TLS), "ca = '/home/anna/ca.pem' is in a home"),
        ((LISTEN, TLS.replace("/home/anna/", "")), "ca = 'ca.pem' is not copied"),
        (('"dbc/mine.dbc"', '"lost.dbc"'), "lost.dbc: No such file"),
        (("pole_pairs = 8", "pole_pairs = 0"), "motor.pole_pairs"),
    ],
)
def test_a_bench_that_would_not_start_is_refused(
    folder: Path, change: tuple[str, str], expected: str
) -> None:
    path = folder / "bench.toml"
    path.write_text(path.read_text().replace(*change))
    done = install(folder)
    assert done.exit_code == 1
    assert expected in done.stderr
    assert files(folder) == ()


def test_the_unit_opens_what_the_bench_reaches(folder: Path) -> None:
    path = folder / "bench.toml"
    text = path.read_text().replace('directory = "runs"', 'directory = "/srv/my $runs"')
    text = text.replace('transport = "rtu"', 'transport = "tcp"\nhost = "192.168.7.20"', 1)
    text += CHANNELS
    path.write_text(text)
    assert install(folder).exit_code == 0
    unit = (folder / "root" / WRITTEN[0]).read_text()
    before, after = unit.split("[Service]")
    assert before.endswith('StartLimitBurst=5\nRequiresMountsFor="/srv/my $runs"\n\n')
    assert 'ReadWritePaths="/srv/my $runs"\n' in after
    allowed = re.findall(r"^IPAddressAllow=(.*)$", unit, re.M)
    assert allowed == ["192.168.7.20", "192.168.7.30", "localhost"]
    path.write_text(text.replace("192.168.7.20", "brake.lab"))
    assert "write the address of brake.lab" in install(folder).stderr


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (None, "install -d -o motord -g motord -m 0750 "),
        ("lost+found", "chown motord "),
        ("of others", ""),
    ],
)
def test_a_folder_of_recordings_is_given_to_the_service_if_it_is_nobody_elses(
    folder: Path, content: str | None, expected: str
) -> None:
    path, runs = folder / "bench.toml", folder / "recordings"
    path.write_text(path.read_text().replace('directory = "runs"', f'directory = "{runs}"'))
    if content is not None:
        (runs / content).mkdir(parents=True)
        expected = expected if runs.stat().st_uid == 0 else ""
    commands = plans.activation(plans.ServiceRequest(str(path), (PROGRAM,)), now=False)
    given = [" ".join(command) for command in commands if str(runs) in command]
    assert given == ([f"{expected}{runs}"] if expected else [])


@pytest.mark.parametrize(
    ("directory", "expected"),
    [
        ("runs", []),
        ("/var/lib/motord/b/runs", []),
        ("../runs", ["/var/lib/runs"]),
        ("/srv/b/../runs", ["/srv/runs"]),
    ],
)
def test_the_unit_opens_the_folder_of_recordings_wherever_it_is(
    folder: Path, directory: str, expected: list[str]
) -> None:
    path = folder / "bench.toml"
    path.write_text(path.read_text().replace('directory = "runs"', f'directory = "{directory}"'))
    assert install(folder).exit_code == 0
    unit = (folder / "root" / WRITTEN[0]).read_text()
    assert re.findall(r"^ReadWritePaths=(.*)$", unit, re.M) == expected


def test_can_channels_are_set_up_if_that_is_asked_for(folder: Path) -> None:
    done = install(folder, "--can-bitrate", 500000, "--can-data-bitrate", 2000000)
    assert done.exit_code == 0, done.output
    text = (folder / "root/etc/systemd/network/80-motord-can0.network").read_text()
    assert re.findall(r"^\w*(?:Name|BitRate|Mode)=.*$", text, re.M) == [
        "Name=can0", "BitRate=500000", "DataBitRate=2000000", "FDMode=yes",
    ]  # fmt: skip
    service("uninstall", "--root", folder / "root")
    assert not any("network" in name for name in files(folder))


def test_a_channel_of_classic_can_is_not_set_up_for_fd(folder: Path) -> None:
    path = folder / "bench.toml"
    path.write_text(path.read_text().replace("fd = true", "fd = false"))
    assert install(folder, "--can-bitrate", 500000).exit_code == 0
    text = (folder / "root/etc/systemd/network/80-motord-can0.network").read_text()
    assert text.endswith("[CAN]\nBitRate=500000\nRestartSec=100ms\n")


@pytest.mark.parametrize("name", ["bench.toml", 'my bench "5%$HOME.toml'])
@pytest.mark.parametrize("user", [False, True])
def test_systemd_finds_nothing_wrong(
    folder: Path, name: str, user: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if shutil.which("systemd-analyze") is None:
        pytest.skip("needs systemd-analyze: apt install systemd")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(folder / "config"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    (folder / "bench.toml").rename(folder / name)
    program = folder / "mo$tord"
    program.symlink_to(PROGRAM)
    request = plans.ServiceRequest(str(folder / name), (str(program),), user=user)
    [unit] = [file for file in plans.files_of(request) if file.path.name == plans.UNIT]
    path = folder / plans.UNIT
    path.write_text(unit.text)
    found = subprocess.run(
        ["systemd-analyze", "verify", *(("--user",) if user else ()), path],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (found.returncode, found.stdout, found.stderr) == (0, "", "")
    assert unit.path.is_relative_to(folder if user else "/etc/systemd/system")


@pytest.fixture
def ran(folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Commands that would be run on a computer with systemd."""
    commands: list[str] = []

    def run(arguments: tuple[str, ...], _: float) -> "subprocess.CompletedProcess[str]":
        commands.append(" ".join(arguments))
        return subprocess.CompletedProcess(arguments, 1 if "fails" in commands else 0, "", "why\n")

    monkeypatch.setattr(host, "_run", run)
    monkeypatch.setattr(host, "is_systemd", lambda: True)
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(folder / "config"))
    monkeypatch.setenv("XDG_STATE_HOME", str(folder / "state"))
    return commands


def test_a_service_of_a_user(folder: Path, ran: list[str]) -> None:
    here = ("install", "--user", "-c", folder / "bench.toml")
    assert "only a service of the system" in service(*here, "--can-bitrate", 500000).stderr
    done = service(*here)
    assert done.exit_code == 0, done.output
    unit = (folder / "config/systemd/user/motord.service").read_text()
    assert f"run --config {folder}/bench.toml" in unit
    assert f"WorkingDirectory={folder}" in unit
    assert ran == ["systemctl --user daemon-reload", "systemctl --user enable --now motord.service"]
    assert "loginctl enable-linger" in done.stdout
    assert "motord.service: as installed" in service("status", "--user").stdout
    ran.clear()
    assert service("uninstall", "--user").exit_code == 0
    assert ran[0] == "systemctl --user disable --now motord.service"
    assert not (folder / "config/systemd/user/motord.service").exists()
    assert (folder / "bench.toml").exists()


def test_a_service_of_the_system_takes_root(folder: Path, ran: list[str]) -> None:
    done = service("install", "-c", folder / "bench.toml", "--program", PROGRAM)
    assert done.exit_code == 1
    assert re.search(r"takes root: sudo /\S+", done.stderr)
    assert done.stderr.count("\n") == 1
    assert ran == []


def test_a_command_that_fails_is_one_line(folder: Path, ran: list[str]) -> None:
    ran.append("fails")
    done = service("install", "--user", "-c", folder / "bench.toml")
    assert done.exit_code == 1
    assert "`systemctl --user daemon-reload` failed: why." in done.stderr


def test_without_systemd_it_says_so(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(host, "is_systemd", lambda: False)
    monkeypatch.setattr("os.geteuid", lambda: 0)
    done = service("install", "-c", folder / "bench.toml", "--program", PROGRAM)
    assert done.exit_code == 1
    assert "systemd does not run this computer" in done.stderr


def test_a_motord_in_a_home_is_no_service_of_the_system(
    folder: Path, ran: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.prefix", "/home/anna/venv")
    monkeypatch.setattr("os.geteuid", lambda: 0)
    done = service("install", "-c", folder / "bench.toml")
    assert done.exit_code == 1
    assert "/home/anna/venv" in done.stderr
    assert "python3 -m venv /opt/motord" in done.stderr
    assert ran == []


def test_without_udev_running_it_is_left_alone(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(host, "UDEV_SOCKET", tmp_path / "control")
    reload = [("udevadm", "control", "--reload"), ("true",)]
    left_out = "left out udevadm control --reload: udev does not run"
    assert host.carry_out(reload) == [left_out, "ran true"]
    (tmp_path / "control").touch()
    (tmp_path / "udevadm").write_text("#!/bin/sh\necho it is asleep >&2; exit 1\n")
    (tmp_path / "udevadm").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(host.DeploymentError, match="`udevadm control --reload` failed: it is asl"):
        host.carry_out(reload)
