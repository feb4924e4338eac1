"""Shared memory of the processes: tick ring, set-point mailbox, tables, run directory."""
