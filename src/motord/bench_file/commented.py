"""A bench as TOML, new or with a comment for each key from the models' own descriptions."""

import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from motord.bench_file.content import Answers, Ask, adapt
from motord.bench_file.templates import (
    CHECK,
    TEMPLATES,
    KeyComments,
    Tables,
    Template,
    known,
    notes,
)
from motord.config import Config, ConfigError
from motord.config.reading import check_text
from motord.config.text.descriptions import description, section_of, summary
from motord.config.text.editing import toml_key, toml_value

WIDTH = 100
OF_DEVICES = ("inverter", "torque_sensor", "brake", "drive", "motor", "limits")
"""Tables whose values are right for one bench alone."""
NOT_OF_DEVICES = (
    "driver", "interface", "options", "phase_order", "encoder_direction", "encoder_offset_rad",
)  # fmt: skip
"""Keys of those that were chosen with the template, or that `motord plan start align` finds."""


@dataclass(frozen=True)
class _Comments:
    """What is said of values: descriptions, or the example's own comments where there are none."""

    notes: KeyComments
    answered: frozenset[str]
    real: bool

    def of(self, section: type[BaseModel], key: str, place: str) -> str:
        """Return the comment of a value. place: the key with its tables."""
        meaning = (
            self.notes.own.get(place)
            or description(section, _name(section, key))
            or self.notes.general.get(place, "")
        )
        if self.real and self._is_unchecked(place):
            return f"{CHECK}: {meaning}" if meaning else CHECK
        return meaning

    def _is_unchecked(self, place: str) -> bool:
        table, _, key = place.rpartition(".")
        return table.partition(".")[0] in OF_DEVICES and not (
            place in self.answered or table in self.answered or key in NOT_OF_DEVICES
        )


def commented(
    tables: Tables, template: Template, notes: KeyComments, answered: frozenset[str]
) -> str:
    """Return the text of a bench file.

    notes: comments of the example by key; answered: keys whose value is not the example's.
    """
    comments = _Comments(notes, answered, template.real)
    lines = [f"# {line}" if line else "#" for line in _header(template)]
    for name, table in tables.items():
        section = section_of(Config.model_fields[name])
        assert section is not None
        lines += _table(name, table, section, comments)
    return "\n".join(lines) + "\n"


def _header(template: Template) -> Iterator[str]:
    yield f"A bench file of motord {version('motord')}:"
    yield f"{template.summary}."
    yield ""
    yield "Names carry their units. Files are looked for next to this one; `package:NAME` ships"
    yield "with motord. What is left out has its default; what is wrong is named by line."
    if template.real:
        yield ""
        yield f"Where it says {CHECK}, the value is an example's: nobody was asked for it. Look it"
        yield "up in the device's manual, correct it, and remove the word."


def _table(
    name: str, table: Mapping[str, Any], section: type[BaseModel], comments: _Comments
) -> Iterator[str]:
    """Yield the lines of a table: its values, then the tables within it."""
    inner = {
        key: kind
        for key, value in table.items()
        if isinstance(value, dict)
        and (kind := section_of(section.model_fields[_name(section, key)])) is not None
    }
    values = {key: value for key, value in table.items() if key not in inner}
    if values or not inner:
        yield ""
        yield from _comment_lines(summary(section))
        yield f"[{name}]"
    for key, value in values.items():
        yield from _line(key, value, comments.of(section, key, f"{name}.{key}"))
    for key, kind in inner.items():
        yield from _table(f"{name}.{toml_key(key)}", table[key], kind, comments)


def _name(section: type[BaseModel], key: str) -> str:
    """Return the field's name of a key; those of plans have hyphens."""
    return key if key in section.model_fields else key.replace("-", "_")


def _line(key: str, value: Any, meaning: str) -> Iterator[str]:
    """Yield a key with its comment: behind it where that fits, else above it."""
    text = f"{toml_key(key)} = {_value(value)}"
    if "\n" not in text and len(text) + len(meaning) + 4 <= WIDTH:
        yield f"{text}  # {meaning}" if meaning else text
    else:
        yield from _comment_lines(meaning)
        yield text


def _comment_lines(text: str) -> list[str]:
    return [f"# {line}" for line in textwrap.wrap(text, WIDTH - 2)]


def _value(value: Any) -> str:
    """Return a value on one line, lists of tables and what is too long on several."""
    line = toml_value(value)
    if isinstance(value, list) and value and (isinstance(value[0], dict) or len(line) > WIDTH - 20):
        inner = "".join(f"    {toml_value(one)},\n" for one in value)
        return f"[\n{inner}]"
    return line


def new_bench_file(
    template: str, inverter: str, answers: Answers, ask: Ask | None, where: Path
) -> tuple[str, Config]:
    """Return the text of a new bench file, and the bench that it describes.

    answers: by key, such as `motor.pole_pairs`; ask: asked for what is missing, or None to take
    the defaults. where: the file's path, which other files are relative to. Raises ConfigError.
    """
    if template not in TEMPLATES:
        raise ConfigError(f"no template {template}; there are {', '.join(TEMPLATES)}")
    start = TEMPLATES[template]
    tables, answered = adapt(start, inverter, where, answers, ask)
    text = commented(tables, start, notes(start, inverter), answered | known(inverter))
    return text, check_text(where, text)
