"""A plan's settings as they are typed: KEY=VALUE."""

from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import typer

from motord.untrusted import parse_json

if TYPE_CHECKING:
    from motord.client import Client


def settings_of(client: "Client", name: str, given: list[str]) -> dict[str, Any]:
    """Return the settings as JSON values; one number for a list is a list of one."""
    if not given:
        return {}
    plans = {plan.name: plan.settings for plan in client.plans()}
    return parse_settings(given, plans.get(name, {}))


def parse_settings(given: list[str], defaults: Mapping[str, Any]) -> dict[str, Any]:
    """Return KEY=VALUE pairs as a dict; raises typer.BadParameter for what is no pair, or twice.

    KEY.NAME=VALUE is an entry of a setting that is a table, over the entries of KEY=VALUE, wherever
    that stands, else over those of the `defaults`.
    """
    settings: dict[str, Any] = {}
    pairs = [_pair(one) for one in given]
    keys = [key for key, _ in pairs]
    for key in keys:
        if keys.count(key) > 1:
            raise typer.BadParameter(f"--set {key}: is given twice; a list is {key}=VALUE,VALUE")
    for key, value in pairs:
        if "." not in key:
            settings[key] = _listed(value) if isinstance(defaults.get(key), list) else value
    for key, value in pairs:
        table, dot, name = key.partition(".")
        if not dot:
            continue
        entries = settings.get(table, defaults.get(table, {}))
        if not isinstance(entries, Mapping):
            raise typer.BadParameter(f"--set {key}: {table} is no table")
        settings[table] = {**entries, name: value}
    return settings


def _pair(text: str) -> tuple[str, Any]:
    key, equals, value = text.partition("=")
    if not equals or not all(key.split(".")):
        raise typer.BadParameter(f"--set {text}: expected KEY=VALUE or KEY.NAME=VALUE")
    return key, value_of(value)


def _listed(value: Any) -> list[Any]:
    """Return the value of a setting that is a list: text by commas, anything else as it is."""
    if isinstance(value, str):
        return [value_of(part.strip()) for part in value.split(",")]
    return value if isinstance(value, list) else [value]


def value_of(text: str) -> Any:
    """Return what was typed as a JSON value: a number, a list (also without brackets), or text."""
    for candidate in (text, f"[{text}]"):
        with suppress(ValueError):
            return parse_json(candidate)
    return text
