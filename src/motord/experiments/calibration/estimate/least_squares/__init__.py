"""The joint estimator: a weighted least squares with instruments, its errors, Kirchhoff's law."""
