"""The simulated rig: motor, inverter, brake, belt drive and sensors. Pure: no I/O, no clock."""
