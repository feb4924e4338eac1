"""Moment of inertia, by free oscillation between springs and by acceleration."""
