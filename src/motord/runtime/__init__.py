"""The real-time loop process and the shared memory through which it talks to the others."""
