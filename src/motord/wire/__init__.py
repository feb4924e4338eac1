"""What the bytes on each wire mean: CAN messages, bridge frames, Modbus registers, tick blocks.

Pure functions of their arguments: no device is opened and no clock is read here. Every codec works
in both directions, so that the daemon and the emulated devices share it.
"""
