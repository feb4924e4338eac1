"""A plan's settings as they are typed: KEY=VALUE."""

import json
from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from motord.client import Client


def settings_of(client: "Client", name: str, given: list[str]) -> dict[str, Any]:
    """Return the settings as JSON values; one number for a list is a list of one."""
    if not given:
        return {}
    plans = {plan.name: plan.settings for plan in client.plans()}
    return parse_settings(given, plans.get(name, {}))


def parse_settings(given: list[str], defaults: Mapping[str, Any]) -> dict[str, Any]:
    """Return KEY=VALUE pairs as a dict; raises typer.BadParameter for what is no pair.

    KEY.NAME=VALUE is an entry of a setting that is a table.
    """
    settings: dict[str, Any] = {}
    for pair in given:
        key, equals, text = pair.partition("=")
        if not equals or not key:
            raise typer.BadParameter(f"--set {pair}: expected KEY=VALUE")
        value = value_of(text)
        if isinstance(defaults.get(key), list) and not isinstance(value, list):
            value = [value]
        table, dot, name = key.partition(".")
        if not dot:
            settings[key] = value
        elif isinstance(entries := settings.setdefault(table, {}), dict):
            entries[name] = value
        else:
            raise typer.BadParameter(f"--set {pair}: {table} is a value already")
    return settings


def value_of(text: str) -> Any:
    """Return what was typed as a JSON value: a number, a list (also without brackets), or text."""
    for candidate in (text, f"[{text}]"):
        with suppress(ValueError):
            return json.loads(candidate)
    return text
