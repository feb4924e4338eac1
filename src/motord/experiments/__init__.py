"""Experiments: one folder each, with its plan, estimate and report."""
