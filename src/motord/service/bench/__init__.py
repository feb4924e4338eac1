"""The bench as the supervisor runs it."""
