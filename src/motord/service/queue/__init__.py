"""The queue of plans: items, file, waits, and what begins one plan after the other."""
