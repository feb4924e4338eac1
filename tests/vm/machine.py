"""A virtual machine that runs one command on this computer's files and ends.

Its kernel is Debian's, its root this computer's file tree, read-only over 9p with a layer of memory
above it, so that the interpreter, its packages and the sources are those of here. It has no
network. What the command leaves in the folder `out` is there afterwards.
"""

import os
import shlex
import shutil
import subprocess
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from tests.vm import kernel

PROCESSOR = "Nehalem"
"""The oldest that the packages' compiled parts run on: what it cannot do need not be emulated."""
PROCESSORS = 1
MEMORY_MB = 2048
CLOCK = ("-accel", "tcg,thread=single", "-icount", "shift=0,sleep=off")
"""The machine's clock counts instructions, 1 ns each: a busy computer changes nothing in it."""
PACKAGES = {"qemu-system-x86_64": "qemu-system-x86", "busybox": "busybox-static"}

INIT = """#!/bin/busybox sh
b=/bin/busybox
$b mount -t proc proc /proc
$b mount -t sysfs sysfs /sys
$b mount -t devtmpfs dev /dev
for module in /modules/*; do $b insmod $module; done
share="trans=virtio,version=9p2000.L,msize=512000"
$b mount -t 9p -o $share,ro,cache=loose root /host
$b mkdir /layer /whole
$b mount -t tmpfs layer /layer
$b mkdir /layer/upper /layer/work
$b mount -t overlay -o lowerdir=/host,upperdir=/layer/upper,workdir=/layer/work layer /whole
$b mount -t proc proc /whole/proc
$b mount -t sysfs sysfs /whole/sys
$b mount -t devtmpfs dev /whole/dev
$b mkdir -p /whole/dev/pts /whole/dev/shm
$b mount -t devpts devpts /whole/dev/pts
$b mount -t tmpfs shm /whole/dev/shm
$b mkdir -p /whole/tmp/out
$b mount -t 9p -o $share,rw,cache=none out /whole/tmp/out
$b ip link set lo up
$b chroot /whole /bin/sh /tmp/out/command
echo $? > /whole/tmp/out/code
$b sync
$b poweroff -f
"""


@dataclass(frozen=True)
class Ended:
    """What a run left: the exit code of the command, None if it did not get so far; the console."""

    code: int | None
    console: str


def missing() -> str:
    """Return what must be installed, as a command; "" if nothing."""
    absent = [package for program, package in PACKAGES.items() if not shutil.which(program)]
    if absent:
        return f"apt install {' '.join(absent)}"
    return "" if kernel.newest() else kernel.FETCH


def run(command: list[str], out: Path, timeout_s: float, environment: dict[str, str]) -> Ended:
    """Run a command as root in a machine of its own, in this folder; see `Ended`."""
    booted = kernel.newest()
    busybox = shutil.which("busybox")
    assert booted is not None
    assert busybox is not None
    inherited = {name: os.environ[name] for name in ("PATH", "PYTHONPATH") if name in os.environ}
    settings = {"HOME": "/root", **inherited, **environment}
    lines = [f"export {name}={shlex.quote(value)}" for name, value in settings.items()]
    lines += [f"cd {shlex.quote(str(Path.cwd()))}", f"exec {shlex.join(command)}"]
    (out / "command").write_text("\n".join(lines) + " > /tmp/out/said 2>&1\n")
    (out / "initramfs").write_bytes(kernel.initramfs(booted, Path(busybox), INIT))
    console = out / "console"
    with suppress(subprocess.TimeoutExpired):
        subprocess.run(_qemu(booted, out, console), check=True, timeout=timeout_s)
    code = out / "code"
    return Ended(
        int(code.read_text()) if code.exists() and code.read_text() else None,
        console.read_text(errors="replace") if console.exists() else "",
    )


def _qemu(booted: kernel.Kernel, out: Path, console: Path) -> list[str]:
    shares = [
        option
        for tag, path, how in (("root", "/", ",readonly=on"), ("out", str(out), ""))
        for option in (
            "-fsdev", f"local,id={tag},path={path},security_model=none,multidevs=remap{how}",
            "-device", f"virtio-9p-pci,fsdev={tag},mount_tag={tag}",
        )
    ]  # fmt: skip
    return [
        "qemu-system-x86_64", "-nodefaults", "-no-user-config", "-display", "none", "-no-reboot",
        *CLOCK, "-machine", "q35", "-cpu", PROCESSOR,
        "-smp", str(PROCESSORS), "-m", str(MEMORY_MB), "-nic", "none",
        "-serial", f"file:{console}", "-kernel", str(booted.image),
        "-initrd", str(out / "initramfs"), *shares,
        "-append", "console=ttyS0 quiet panic=-1 no_timer_check mitigations=off nokaslr",
    ]  # fmt: skip
