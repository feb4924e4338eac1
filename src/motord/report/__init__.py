"""Plots and pages from arrays: one self-contained HTML file, readable light, dark and on paper."""
