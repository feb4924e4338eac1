"""The devices of a bench on the wire, in a process of its own: inverter, bridge, brake, drive.

`bench` joins the devices to the simulated rig, without I/O; `devices` and `bridge.board` are what
each device does; `can`, `bridge`, `modbus` and `pty` put them on the wire; `faults` disturbs all of
it by timeline or by `control`; `process` paces everything in real time.
"""


class EmulatorError(Exception):
    """The emulator cannot start; the message says what, where and what to do."""
