"""Sensitivity of torque ripple to errors of gains, offsets and cogging torque."""
