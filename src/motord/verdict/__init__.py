"""Verdict of a motor against its type's limits, by the uncertainty of what was measured."""
