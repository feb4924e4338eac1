"""From recorded operating points to alpha, beta and cogging torque: arrays in, results out."""


class IdentifyError(Exception):
    """Data that cannot tell what was asked; the message says what is missing and what to do."""
