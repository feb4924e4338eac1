"""Torque ripple over the mesh, with and without compensation."""
