"""Frames of CANopen (CiA 301) that a host sends: NMT, SYNC and heartbeat, as key and payload."""

SYNC = (0x080, b"")
"""PDOs of transmission types 0 to 240 are in force, and are sent, from here on."""
_NMT, _HEARTBEAT = 0x000, 0x700
_START, _OPERATIONAL = 1, 5


def nmt_start(node: int) -> tuple[int, bytes]:
    """Return the order to become operational; node 0 is all nodes."""
    return _NMT, bytes((_START, node))


def heartbeat(node: int) -> tuple[int, bytes]:
    """Return the heartbeat of a node that is operational."""
    return _HEARTBEAT + node, bytes((_OPERATIONAL,))
