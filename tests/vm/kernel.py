"""A Debian kernel to boot: finding its package, and an initramfs of busybox and a few modules.

    python -m tests.vm.kernel

downloads the package that `linux-image-amd64` stands for into the user's cache; nothing is
installed, and no rights are needed.
"""

import lzma
import os
import re
import stat
import subprocess
import sys
import tempfile
import zlib
from dataclasses import dataclass, field
from pathlib import Path

CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "motord" / "vm"
META_PACKAGE = "linux-image-amd64"
MODULES = ("virtio_pci", "9pnet_virtio", "9p", "overlay", "vcan", "can-raw")
FETCH = f"{Path(sys.executable).name} -m tests.vm.kernel"


@dataclass(frozen=True)
class Kernel:
    """A kernel's image, and `MODULES` with what they need, each after what it needs."""

    image: Path
    modules: tuple[Path, ...]


def newest() -> Kernel | None:
    """Return the newest kernel in the cache; None if there is none."""
    packages = sorted(CACHE.glob("*.deb"), key=lambda path: path.stat().st_mtime)
    if not packages:
        return None
    wanted = zlib.crc32(" ".join(MODULES).encode())
    folder = packages[-1].with_suffix(f".{wanted:08x}")
    if not folder.exists():
        with tempfile.TemporaryDirectory(dir=CACHE) as scratch:
            _pick(packages[-1], Path(scratch)).rename(folder)
    return Kernel(folder / "vmlinuz", tuple(sorted(folder.glob("*.ko"))))


def _pick(package: Path, scratch: Path) -> Path:
    """Return a folder with what is wanted of a package."""
    whole, picked = scratch / "whole", scratch / "picked"
    subprocess.run(["dpkg-deb", "-x", package, whole], check=True)
    picked.mkdir()
    next((whole / "boot").glob("vmlinuz-*")).rename(picked / "vmlinuz")
    modules = {
        path.name.partition(".ko")[0].replace("-", "_"): _content(path)
        for path in whole.rglob("*.ko*")
        if path.is_file()
    }
    for place, name in enumerate(_in_order(modules)):
        (picked / f"{place:02}-{name}.ko").write_bytes(modules[name])
    return picked


def _in_order(modules: dict[str, bytes]) -> list[str]:
    ordered: list[str] = []

    def add(name: str) -> None:
        name = name.replace("-", "_")
        if name in modules and name not in ordered:  # what is not there is built in
            for needed in _depends(modules[name]):
                add(needed)
            ordered.append(name)

    for name in MODULES:
        add(name)
    return ordered


def _content(module: Path) -> bytes:
    data = module.read_bytes()
    if module.suffix == ".xz":
        return lzma.decompress(data)
    if module.suffix == ".zst":
        import zstandard  # the rest runs without the project's packages, to fetch a kernel

        return zstandard.ZstdDecompressor().decompressobj().decompress(data)
    return data


def _depends(content: bytes) -> list[str]:
    found = re.search(rb"\0depends=([^\0]+)\0", content)
    return found[1].decode().split(",") if found else []


def fetch() -> Path:
    """Download the kernel's package into the cache, if it is not there. Raises SystemExit."""
    shown = subprocess.run(["apt-cache", "depends", META_PACKAGE], capture_output=True, text=True)
    name = re.search(r"Depends: (linux-image-\S+)", shown.stdout)
    if name is None:
        raise SystemExit(f"apt knows no package {META_PACKAGE}; on Debian: apt-get update")
    CACHE.mkdir(parents=True, exist_ok=True)
    get = ("apt-get", "-qq", "-o", "APT::Sandbox::User=root", "download", name[1])
    subprocess.run(get, check=True, cwd=CACHE)
    return next(CACHE.glob(f"{name[1]}_*.deb"))


@dataclass
class Archive:
    """A cpio archive in the format `newc`, as the kernel unpacks it."""

    data: bytearray = field(default_factory=bytearray)
    _count: int = 0

    def folder(self, name: str) -> None:
        self._add(name, stat.S_IFDIR | 0o755, b"")

    def file(self, name: str, content: bytes) -> None:
        self._add(name, stat.S_IFREG | 0o755, content)

    def close(self) -> bytes:
        self._add("TRAILER!!!", 0, b"")
        return bytes(self.data)

    def _add(self, name: str, mode: int, content: bytes) -> None:
        self._count += 1
        path = name.encode() + b"\0"
        numbers = (self._count, mode, 0, 0, 1, 0, len(content), 0, 0, 0, 0, len(path), 0)
        self.data += b"070701" + b"".join(b"%08X" % number for number in numbers) + path
        self._pad()
        self.data += content
        self._pad()

    def _pad(self) -> None:
        self.data += bytes(-len(self.data) % 4)


def initramfs(kernel: Kernel, busybox: Path, init: str) -> bytes:
    """Return the archive to boot with: the script `init`, busybox, `/modules` in their order."""
    archive = Archive()
    for name in ("bin", "dev", "proc", "sys", "host", "modules"):
        archive.folder(name)
    archive.file("bin/busybox", busybox.read_bytes())
    archive.file("init", init.encode())
    for module in kernel.modules:
        archive.file(f"modules/{module.name}", module.read_bytes())
    return archive.close()


if __name__ == "__main__":
    sys.stdout.write(f"{fetch()}\n")
