"""Why a serial port cannot be opened, and what to do about it."""

import errno

HINTS = {
    errno.ENOENT: "there is no such port; is the {device} plugged in, and is {key} right?",
    errno.EACCES: "no permission; add the user to the group of the port (often dialout)",
    errno.EAGAIN: "it is in use by another program",
    errno.EBUSY: "it is in use by another program",
    errno.ENOTTY: "it is no serial port; is {key} right?",
    errno.EISDIR: "it is no serial port; is {key} right?",
}


def port_obstacle(error: Exception, device: str, key: str) -> str:
    """Return why the port of a device cannot be opened; `key` names it in the bench file.

    error: of pyserial, which keeps some numbers to the error that it began with.
    """
    began: object = getattr(error, "errno", None)
    if began is None and error.__context__ is not None and error.__context__.args:
        began = error.__context__.args[0]
    hint = HINTS.get(began) if isinstance(began, int) else None
    return str(error) if hint is None else hint.format(device=device, key=key)
