"""A whole bench: `[bench] [loop] [limits] [recording] [zenoh] [plans.*]` and the devices."""

from pydantic import model_validator

from motord.config.rules import RULES
from motord.config.sections import Sections


class Config(Sections):
    """A whole bench, whose tables go together."""

    @model_validator(mode="after")
    def _rules_hold(self) -> "Config":
        for rule in RULES:
            if reasons := list(rule(self)):
                raise ValueError("; ".join(reasons))
        return self
