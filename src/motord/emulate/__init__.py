"""The devices of a bench on the wire, in a process of its own: inverter, bridge, brake, drive.

`devices` holds what each device does, without I/O; `rig` joins them to the simulated rig; `can`,
`bridge`, `modbus` and `pty` put them on the wire; `process` paces them in real time.
"""


class EmulatorError(Exception):
    """The emulator cannot start; the message says what, where and what to do."""
