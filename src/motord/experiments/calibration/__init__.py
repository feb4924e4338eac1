"""Calibration: current gains alpha, current offsets beta and cogging torque from the mesh."""
