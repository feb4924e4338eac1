"""Settings of a driver of another package: `[inverter.settings]` and the like of the bench file."""

from typing import Literal, TypeVar

from pydantic import ValidationError

from motord.config import Config
from motord.config.base import Section
from motord.hal.base import DeviceError
from motord.section.complaints import wrong_things

SettingsT = TypeVar("SettingsT", bound=Section)


def read_settings(
    kind: Literal["inverter", "bridge", "brake", "drive"], model: type[SettingsT], config: Config
) -> SettingsT:
    """Return the settings that a bench file has for the driver of a device, as `model` has them.

    Raises DeviceError, a line of which names each key that is missing, unknown or wrong.
    """
    try:
        return model.model_validate(getattr(config, kind).settings)
    except ValidationError as error:
        wrong = (f"[{kind}.settings] {one}" for one in wrong_things(error))
        raise DeviceError("\n".join(wrong)) from None
