"""What an operator sets of a plan, over the bench's own settings, checked before anything moves."""

from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import ValidationError

from motord.config import Config, Section
from motord.schema import Compensate, Compensation
from motord.section.complaints import wrong_setting

Settings = TypeVar("Settings", bound=Section)


class PlanError(Exception):
    """A plan that cannot be run; the message says which setting and why."""


def chosen(
    config: Config, name: str, section: type[Settings], given: Mapping[str, Any], *others: str
) -> Settings:
    """Return the settings of `[plans.NAME]`, a `section`, with those `given` in their place.

    others: names that the plan knows besides these settings, for the message. Raises PlanError.
    """
    own = config.plans.of(name, section)
    try:
        return section.model_validate({**own.model_dump(), **given})
    except ValidationError as error:
        known = [*section.model_fields, *others]
        raise PlanError(f"{name}: {wrong_setting(error, known)}") from None


COMPENSATE: dict[Compensation, Compensate] = {
    "off": Compensate(0),
    "on": Compensate.CURRENTS | Compensate.COGGING | Compensate.LEARNED,
    "calibration": Compensate.CURRENTS | Compensate.COGGING,
    "currents": Compensate.CURRENTS,
    "cogging": Compensate.COGGING,
}
"""What of the calibration is applied, by the values of settings and requests."""


def compensation(setting: object) -> Compensate:
    """Return the flags that a setting stands for. Raises PlanError."""
    if isinstance(setting, str) and setting in COMPENSATE:
        return COMPENSATE[setting]
    raise PlanError(f"compensate = {setting!r}: one of {', '.join(COMPENSATE)}")
