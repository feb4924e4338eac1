"""From recorded operating points to alpha, beta and cogging torque: arrays in, results out."""


class IdentifyError(Exception):
    """Data that do not determine what was asked; the message says what is missing, what to do."""


class CaptureError(IdentifyError):
    """One capture cannot be used; others of the same recordings may be."""
