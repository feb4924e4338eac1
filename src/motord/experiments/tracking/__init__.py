"""Tracking of the calibration in force in ordinary operation; it changes nothing by itself."""
