"""The control kernel: estimate, reference, limits, interlocks, step. Pure, compiled, no I/O."""
