"""Cogging torque from a rotor driven without current."""
