"""Disturbances of the torque that are not of the motor."""
