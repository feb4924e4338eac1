"""The shipped unit under Debian's systemd: starts, comes back OFF after its loop stopped, stops.

systemd runs as PID 1 of namespaces of its own, on a layer of memory above this computer's files;
sources and packages are put where the unit looks for an installation. It takes root, as mounting
does: with MOTORD_TEST_SUDO=1 by `sudo`, which may not ask for a password.
"""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

import pytest

from motord.kernel_cache import kernel_cache
from tests.system.daemons import write_sim

pytestmark = pytest.mark.system

HERE = Path(__file__).parent / "systemd"
ROOT = Path(__file__).parents[2]
SYSTEMD = Path("/lib/systemd/systemd")
TIMEOUT_S = 600.0
NAMESPACES = ("--pid", "--fork", "--kill-child", "--mount", "--cgroup", "--net", "--ipc", "--uts")
UNSHARE = ("unshare", *NAMESPACES)


def command() -> list[str]:
    """Return what becomes root in new namespaces; skips where that cannot be."""
    if not SYSTEMD.exists():
        pytest.skip("needs systemd: apt install systemd")
    root = os.geteuid() == 0
    sudo = ["sudo", "-n"] if os.environ.get("MOTORD_TEST_SUDO") == "1" and not root else []
    if not root and not sudo:
        pytest.skip("mounting takes root; MOTORD_TEST_SUDO=1 does it by sudo")
    tried = subprocess.run(
        [*sudo, *UNSHARE, "sh", "-c", "mount --make-rprivate / && mount -t cgroup2 none /mnt"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if tried.returncode != 0:
        pytest.skip(f"no namespaces of its own for systemd: {tried.stderr.strip()}")
    return [*sudo, *UNSHARE]


def install(layer: Path) -> None:
    """Put together what the manager's script takes (`manager.sh`)."""
    for name in ("memory", "whole", "out", "cache", "opt/bin"):
        (layer / name).mkdir(parents=True)
    opt = layer / "opt"
    shutil.copytree(ROOT / "src", opt / "src")
    shutil.copy(HERE / "scenario.py", opt / "scenario.py")
    for name in ("packages", "python"):  # mounted there; the interpreter may be in somebody's home
        (opt / name).mkdir()
    python = Path(sys.executable).resolve().relative_to(sys.base_prefix)
    for name, run in (("motord", "-m motord"), ("scenario", "/opt/motord/scenario.py")):
        path = opt / "bin" / name
        path.write_text(
            "#!/bin/sh\nexport PYTHONDONTWRITEBYTECODE=1 PYTHONHOME=/opt/motord/python "
            "PYTHONPATH=/opt/motord/src:/opt/motord/packages "
            "LD_LIBRARY_PATH=/opt/motord/python/lib\n"
            f'exec /opt/motord/python/{python} {run} "$@"\n'
        )
        path.chmod(0o755)
    subprocess.run(["chmod", "-R", "a+rX", str(opt)], check=True)
    write_sim(layer, "bench")
    compiled = kernel_cache()  # named and trusted by what the sources are, not where: saves 20 s
    if compiled.exists():
        shutil.copytree(compiled, layer / "cache" / "motord" / compiled.name)


@pytest.fixture(scope="module")
def facts(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    unshare = command()
    layer = tmp_path_factory.mktemp("systemd")
    install(layer)
    opt, packages = layer / "opt", sysconfig.get_path("purelib")
    script = " && ".join(
        (
            "mount --make-rprivate /",
            f'mount --bind "{packages}" "{opt}/packages"',
            f'mount --bind "{sys.base_prefix}" "{opt}/python"',
            'exec sh "$0" "$@"',
        )
    )
    done = subprocess.run(
        [*unshare, "sh", "-c", script, HERE / "manager.sh", layer],
        capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
    )  # fmt: skip
    parts = [done.stdout, done.stderr]
    for name in ("said", "log", "results"):
        path = layer / "out" / name
        parts.append(path.read_text(errors="replace") if path.exists() else "")
    log = "\n".join(parts)
    left = layer / "out" / "facts.json"
    assert left.exists(), log
    return {"log": log, "results": parts[-1].split(), **json.loads(left.read_text())}


def test_it_starts_as_its_own_user_and_off(facts: dict[str, Any]) -> None:
    assert facts["start"] == 0, facts["log"]
    assert (facts["started"]["ActiveState"], facts["started"]["NRestarts"]) == ("active", "0")
    assert facts["uid"] != 0
    assert facts["state"] == "OFF"


def test_its_kernels_are_those_of_this_computer(facts: dict[str, Any]) -> None:
    assert facts["kernels"] == [kernel_cache().name]


def test_it_comes_back_off_after_its_loop_stopped(facts: dict[str, Any]) -> None:
    assert facts["enabled"] == "ENABLED"
    assert facts["results"][0] == "watchdog", facts["log"]
    again = facts["restarted"]
    assert (again["ActiveState"], again["NRestarts"]) == ("active", "1"), facts["log"]
    assert again["MainPID"] != facts["started"]["MainPID"]
    assert facts["state again"] == "OFF"


def test_it_stops_by_itself_and_leaves_nothing(facts: dict[str, Any]) -> None:
    """Not killed: that would be a result of its own, and an exit status."""
    assert facts["stop"] == 0
    stopped = facts["stopped"]
    assert (stopped["ActiveState"], stopped["Result"]) == ("inactive", "success"), facts["log"]
    assert stopped["ExecMainStatus"] == "0"
    assert facts["results"] == ["watchdog", "success"]
    assert facts["left"] == []


def test_its_status_is_that_of_the_running_unit(facts: dict[str, Any]) -> None:
    unit, limits = facts["status"]["unit"], facts["status"]["limits"]
    assert (unit["ActiveState"], unit["MainPID"]) == ("active", facts["started"]["MainPID"])
    assert limits["rt_priority"].isdigit()  # how high is for the computer to say
    assert limits["locked_memory_bytes"]
    assert set(facts["status"]["files"].values()) == {"same"}


def test_uninstalling_leaves_what_is_the_bench_s(facts: dict[str, Any]) -> None:
    code, said = facts["uninstall"]
    assert code == 0, said
    assert facts["unit left"] == "not-found"
    assert facts["bench left"]
    assert facts["recordings"]
