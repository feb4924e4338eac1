"""The interface that the tests of the virtual machine have to themselves."""

import subprocess

from tests.contract.peers import SOCKETCAN

FD_MTU, CLASSIC_MTU = 72, 16


def ip(*arguments: object) -> None:
    """Run `ip` of busybox, which the machine has anyway."""
    subprocess.run(["busybox", "ip", *map(str, arguments)], check=True)


def down() -> None:
    ip("link", "set", SOCKETCAN, "down")


def up() -> None:
    ip("link", "set", SOCKETCAN, "up")


def make(mtu: int = FD_MTU) -> None:
    ip("link", "add", "dev", SOCKETCAN, "type", "vcan")
    ip("link", "set", SOCKETCAN, "mtu", mtu)
    up()


def remove() -> None:
    ip("link", "del", SOCKETCAN)
