"""Layouts of the frames between host and bridge board.

Made by tools/bridge_layout.py from firmware_bridge/protocol/bridge_frames.h: change that.
"""

PROTOCOL = 2
"""Version that both sides name in `HelloRequest` and `Hello`."""

LAYOUTS = {
    "Hello": (0x01, "HI16sIIIII"),
    "Sample": (0x02, "IIiH"),
    "Status": (0x03, "IHHIIIIIIB"),
    "HelloRequest": (0x11, "H"),
    "Configure": (0x12, "II"),
    "Start": (0x13, ""),
    "Stop": (0x14, ""),
    "Heartbeat": (0x15, "B"),
}
"""Of each frame its type byte, and the widths of its fields as `struct` writes them."""
