"""The real-time loop process: wake up on time, read, decide, write, publish."""
