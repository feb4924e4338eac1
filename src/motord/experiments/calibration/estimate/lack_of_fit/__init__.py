"""Lack of fit: residuals of the joint estimator beyond noise, their causes and findings."""
