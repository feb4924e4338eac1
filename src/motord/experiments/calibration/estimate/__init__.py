"""Estimators of alpha, beta and cogging torque: joint least squares and the residual method."""
