"""What the stand-in of the daemon was asked for."""

from tests.browser.stand_in import Server


def names(server: Server) -> list[str]:
    """Return the requests that the daemon got, but for those that renew."""
    return [name for name, _ in server.stand_in.requests if name != "lease/renew"]


def commands(server: Server) -> list[str]:
    """Return those that move something."""
    return [name for name in names(server) if name in ("enable", "set", "plan/start", "stop")]
