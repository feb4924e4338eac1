"""Torque: how its sensor shows it, and what of it the currents make."""
