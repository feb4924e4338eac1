"""Lack of fit: what the joint estimator leaves beyond noise, its causes and its findings."""
