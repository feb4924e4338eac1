"""What is asked of the source of a slow channel, and settings of drivers of other packages.

A driver joins by an entry point in the group `motord.channels`: with `acme = "acme_motord:Probe"` a
channel may say `driver = "acme"`. It is called with the channel's `ChannelConfig` and returns a
`ChannelSource`. It lives in the process that reads all channels, in a thread that it has to itself:
if it raises, hangs or takes the process along, its channel is broken, and the bench goes on.
"""

from dataclasses import dataclass
from math import nan
from typing import NamedTuple, Protocol, TypeVar

from pydantic import ValidationError

from motord.config import ChannelConfig
from motord.config.base import Section
from motord.config.channel_sources import OtherSource
from motord.hal.base import DeviceError
from motord.section.complaints import wrong_things

SettingsT = TypeVar("SettingsT", bound=Section)


class RawSample(NamedTuple):
    """What a source has read: a number, nan if it has none, and how old it was when `read` began.

    The channel's scale and offset are applied to it later.
    """

    value: float
    age_s: float = 0.0


class ChannelSource(Protocol):
    """A source of one channel. All calls come from one thread."""

    def open(self) -> None:
        """Connect. Raises DeviceError; it is then tried again."""

    def read(self) -> RawSample | None:
        """Return the newest sample, None if there is none since the last call.

        Waits at most the `timeout_s` of its settings. Raises DeviceError; the source is then
        closed, and opened again.
        """

    def close(self) -> None:
        """Disconnect; may be called twice."""


@dataclass(frozen=True, slots=True)
class ChannelReading:
    """What the source of the channel `name` said at `t_ns` (monotonic), or why it said nothing."""

    name: str
    t_ns: int
    raw: float = nan
    error: str = ""


def read_channel_settings(model: type[SettingsT], channel: ChannelConfig) -> SettingsT:
    """Return the settings that a bench file has for a driver of another package.

    Raises DeviceError, which names the key, for one that is missing, unknown or wrong.
    """
    settings = channel.source.settings if isinstance(channel.source, OtherSource) else {}
    try:
        return model.model_validate(settings)
    except ValidationError as error:
        raise DeviceError(f"[channels.source.settings] {'; '.join(wrong_things(error))}") from None
