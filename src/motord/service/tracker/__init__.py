"""Tracking of the calibration in force, in a process of its own."""
