"""From recorded operating points to alpha, beta and cogging torque: arrays in, results out."""


class IdentifyError(Exception):
    """Data that do not determine what was asked; the message says what is missing, what to do."""
