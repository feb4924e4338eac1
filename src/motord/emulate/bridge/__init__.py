"""The bridge board: what it does, its end of a serial line or CAN bus, its firmware in QEMU."""
