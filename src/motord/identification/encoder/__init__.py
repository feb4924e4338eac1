"""Counts of the rotor's encoder: which of them show its angle."""
