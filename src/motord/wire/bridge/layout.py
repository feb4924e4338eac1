"""Layouts of the frames between host and bridge board.

Made by tools/bridge_layout.py from firmware_bridge/protocol/bridge_frames.h: change that.
"""

PROTOCOL = 2
"""Version that both sides name in `HelloRequest` and `Hello`."""

LAYOUTS: dict[str, tuple[int, str, tuple[str, ...]]] = {
    "Hello": (
        0x01,
        "HI16sIIIII",
        (
            "protocol",
            "firmware",
            "board",
            "serial",
            "rate_Hz",
            "counts",
            "layout",
            "heartbeat_next",
        ),
    ),
    "Sample": (
        0x02,
        "IIiH",
        (
            "t_us",
            "encoder_gray",
            "torque_counts",
            "status",
        ),
    ),
    "Status": (
        0x03,
        "IHHIIIIIIB",
        (
            "t_us",
            "status",
            "heartbeat_sequence",
            "heartbeat_t_us",
            "heartbeats",
            "errors",
            "dropped",
            "rate_Hz",
            "heartbeat_timeout_us",
            "streaming",
        ),
    ),
    "HelloRequest": (
        0x11,
        "H",
        ("protocol",),
    ),
    "Configure": (
        0x12,
        "II",
        (
            "rate_Hz",
            "heartbeat_timeout_us",
        ),
    ),
    "Start": (
        0x13,
        "",
        (),
    ),
    "Stop": (
        0x14,
        "",
        (),
    ),
    "Heartbeat": (
        0x15,
        "B",
        ("turns_enable",),
    ),
}
"""Of each frame its type byte, the widths of its fields (as `struct` writes them), their names."""
