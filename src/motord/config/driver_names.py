"""Which drivers a bench file can name: motord's own, and those of packages that are installed."""

from collections.abc import Iterator, Mapping
from importlib.metadata import entry_points
from typing import Any

from motord.config.channel_sources import OWN as OWN_SOURCES
from motord.config.devices import DeviceConfig
from motord.section.complaints import suggestion

DRIVERS, CHANNELS = "motord.drivers", "motord.channels"
"""Groups of entry points of drivers for devices, `<device>.<driver>`, and for slow channels."""


def unknown_drivers(
    devices: Mapping[str, type[DeviceConfig]], data: Mapping[str, Any]
) -> Iterator[tuple[list[str], str]]:
    """Yield keys of the content of a bench file that should name a driver, with what is wrong."""
    for kind, model in devices.items():
        table = data.get(kind)
        if isinstance(table, dict) and "driver" in table:
            others = [one.removeprefix(f"{kind}.") for one in _names(DRIVERS, f"{kind}.")]
            yield from _unknown([kind], table, [*model.OWN, *others])
    channels = data.get("channels")
    for number, channel in enumerate(channels if isinstance(channels, list) else ()):
        source = channel.get("source") if isinstance(channel, dict) else None
        if isinstance(source, dict):
            place = ["channels", str(number), "source"]
            yield from _unknown(place, source, [*OWN_SOURCES, *_names(CHANNELS)])


def _names(group: str, prefix: str = "") -> list[str]:
    names = {one.name for one in entry_points(group=group)}
    return sorted(name for name in names if name.startswith(prefix))


def _unknown(
    place: list[str], table: Mapping[str, Any], known: list[str]
) -> Iterator[tuple[list[str], str]]:
    name, may_be = table.get("driver"), f"known: {', '.join(known)}"
    if name is None:
        yield [*place, "driver"], f"missing; {may_be}"
    elif isinstance(name, str) and name not in known:
        yield [*place, "driver"], f'"{name}" is not known; {may_be}{suggestion(name, known)}'
