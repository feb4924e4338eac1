"""`motord record`: recordings looked into, repaired, exported, imported."""

from motord.cli.record.commands import app

__all__ = ["app"]
