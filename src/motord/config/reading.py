"""From TOML to a checked bench; whatever is wrong is named with file, line and key."""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError

from motord.config.base import ConfigError, Section
from motord.config.bench import Config
from motord.config.devices import DeviceConfig
from motord.config.driver_names import unknown_drivers
from motord.config.experiments import PlansConfig, plans_model
from motord.config.motor import MotorFile
from motord.config.named_files import as_kept, named_files, packaged, resolve
from motord.section.complaints import (
    Place,
    complaints,
    dotted,
    is_type,
    message,
    suggestion,
    wrong_things,
)
from motord.untrusted import parse_toml, read_text


def load(path: Path | None = None) -> Config:
    """Read and check a bench file; None is the packaged simulated bench. Raises ConfigError."""
    path = path or packaged("sim.toml")
    text, data = _read_bench(path)
    _resolve_files(path, data)
    return validate(Config, path, text, data)


def load_motor(path: Path) -> MotorFile:
    """Read and check a motor file. Raises ConfigError."""
    text, data = read_toml(path)
    _resolve_files(path, data)
    return validate(MotorFile, path, text, data)


def read_toml(path: Path) -> tuple[str, dict[str, Any]]:
    """Return text and content of a TOML file. Raises ConfigError for one that cannot be read."""
    try:
        text = read_text(path)
    except OSError as error:
        raise ConfigError(f"{path}: cannot read it: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"{path}: not a text file in UTF-8 (byte {error.start}); save it as UTF-8"
        ) from error
    try:
        return text, parse_toml(text)
    except ValueError as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from error


_Model = TypeVar("_Model", bound=Section)


def check_text(path: Path, text: str) -> Config:
    """Check the text of a bench file that is to be at `path`. Raises ConfigError."""
    data = parse_toml(text)
    _resolve_files(path, data)
    return validate(Config, path, text, data)


def load_started(path: Path, kept: Path, *, plans: bool = True) -> tuple[Config, str]:
    """Return the bench of a daemon that runs, and the text of its bench file. Raises ConfigError.

    kept: the text as the daemon read it, next to copies of the files that it names
    (`named_files.keep`); bench file and files may have been edited since. Where there are none, no
    daemon having run, they are read themselves. Without `plans`, for who needs none, no experiment
    is imported and nothing of `[plans.*]` is there.
    """
    text, data = _read_bench(kept if kept.exists() else path)
    _resolve_files(path, data)
    for table, key, file in named_files(data):
        table[key] = as_kept(Path(file), kept)
    if not plans:
        data["plans"] = PlansConfig()
    return validate(Config, path, text, data), text


def check_table(model: type[_Model], name: str, content: dict[str, Any]) -> _Model:
    """Check one table by itself. Raises ConfigError naming its keys."""
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise ConfigError("\n".join(f"[{name}] {one}" for one in wrong_things(error))) from None


def validate(model: type[_Model], path: Path, text: str, data: dict[str, Any]) -> _Model:
    """Build `model` from the content of a TOML file. Raises ConfigError naming file and line."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise ConfigError(_explain(error, model, path, text, data)) from None


def _read_bench(path: Path) -> tuple[str, dict[str, Any]]:
    """Return text and content of a bench file; of one that is not there say how to get it."""
    try:
        return read_toml(path)
    except ConfigError as error:
        if isinstance(error.__cause__, FileNotFoundError):
            raise ConfigError(f"{error}; motord new writes a bench file") from error.__cause__
        raise


def _resolve_files(path: Path, data: dict[str, Any]) -> None:
    """Make the file names of a bench, which are relative to its file, so to the working folder."""
    for table, key, name in named_files(data):
        table[key] = resolve(path, Path(name))


def _explain(
    error: ValidationError, model: type[Section], path: Path, text: str, data: dict[str, Any]
) -> str:
    """Return what is wrong, a line for each place, in the order of the file.

    Left out is what follows from an unknown driver.
    """
    wrong: dict[tuple[int, str], list[str]] = {}
    got: dict[tuple[int, str], str] = {}
    unknown = dict(_unknown_drivers(model, data))
    for item in complaints(error):
        keys = _keys(item["loc"], whole=item["type"] == "extra_forbidden")
        if "Other" in item["loc"] and (*keys[:-1], "driver") in unknown:
            continue
        place = _place(path, text, keys)
        what = _what(item, model, keys)
        if item["type"] not in ("extra_forbidden", "missing") and not isinstance(
            item.get("input"), dict | list
        ):
            what = f"{what[0].lower()}{what[1:]}"
            if not keys or item["input"] != keys[-1]:  # of a key that is wrong it is the key
                got[place] = f", got {item['input']!r}"
        wrong.setdefault(place, []).append(what)
    for of_driver, what in unknown.items():
        wrong[_place(path, text, of_driver)] = [what]
    return "\n".join(
        f"{place[1]}: {', or '.join(dict.fromkeys(wrong[place]))}{got.get(place, '')}"
        for place in sorted(wrong, key=lambda place: place[0])
    )


def _unknown_drivers(
    model: type[Section], data: dict[str, Any]
) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield the keys of a bench file that name no driver, with what is wrong."""
    kinds = {name: field.annotation for name, field in model.model_fields.items()}
    devices = {
        name: kind
        for name, kind in kinds.items()
        if isinstance(kind, type) and issubclass(kind, DeviceConfig)
    }
    for keys, wrong in unknown_drivers(devices, data) if devices else ():
        yield tuple(keys), wrong


def _place(path: Path, text: str, keys: Sequence[str]) -> tuple[int, str]:
    """Return the line of keys, 0 for none, and file, line and keys as text."""
    line = _line_of(text, list(keys))
    where = f"{path}:{line}" if line else str(path)
    return line, f"{where}: {dotted(keys)}" if keys else where


def _what(item: Any, model: type[Section], keys: list[str]) -> str:
    """Return what is wrong, without the value."""
    if item["type"] == "extra_forbidden":
        is_table = isinstance(item["input"], dict)
        return "unknown key" + _suggestion(model, item["loc"], is_table=is_table)
    if item["type"] == "missing":
        return "missing"
    if item["type"] in ("tuple_type", "list_type"):
        table = isinstance(item["input"], dict)
        return f"takes a list, {f'[[{dotted(keys)}]]' if table else '[...]'}"
    if item["type"] in ("model_type", "model_attributes_type", "dict_type"):
        return f"is a table, {f'[{dotted(keys)}]' if keys and not keys[-1].isdigit() else '{...}'}"
    return message(item)


def _keys(place: Place, *, whole: bool) -> list[str]:
    """Return the keys of a place in a file: pydantic's own names of types are left out.

    whole: the last part is as written in the file, whatever it looks like.
    """
    kept = [str(part) for part in place if not is_type(part)]
    last = str(place[-1]) if place else ""
    return [*kept, last] if whole and last and last not in kept[-1:] else kept


def _suggestion(model: type[BaseModel], place: Place, *, is_table: bool) -> str:
    """Return what is meant by the last part of a place, or all that the table there knows."""
    name = str(place[-1])
    if is_table and len(place) > 1 and name in model.model_fields:
        return f"; did you mean [{name}]?"
    tables, of_names = [model], False
    for part in place[:-1]:
        if is_type(part):
            named = [one for one in tables if one.__name__ in str(part)]
            tables = named or [one for one in tables if one.__name__.startswith(str(part))]
        elif of_names:  # a name that the file gives: of a column, say
            of_names = False
        elif isinstance(part, str):
            field = tables[0].model_fields.get(part) if len(tables) == 1 else None
            of_names = field is not None and get_origin(field.annotation) is dict
            tables = [] if field is None else list(_tables(field.annotation))
    if len(tables) != 1:
        return ""
    known = list(tables[0].model_fields)
    sections = _sections_with(model, name)
    elsewhere = f"; it is a key of {' and of '.join(sections)}" if sections else ""
    return elsewhere + suggestion(name, known) or f"; known: {', '.join(known)}"


def _sections_with(model: type[BaseModel], key: str) -> list[str]:
    """Return the sections that have this key."""
    return [
        f"[{name}]"
        for name, field in model.model_fields.items()
        if any(key in table.model_fields for table in _tables(field.annotation))
    ]


def _tables(kind: Any) -> Iterator[type[BaseModel]]:
    """Yield the tables that a value of this type may be, or be a list of."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        yield kind if kind is not PlansConfig else plans_model()
    for part in get_args(kind):
        yield from _tables(part)


def _line_of(text: str, keys: list[str]) -> int:
    """Return the line that defines `keys`, or of the deepest part found, or 0."""
    table: list[str] = []
    arrays: Counter[str] = Counter()
    best, best_depth = 0, 0
    for number, line in enumerate(text.splitlines(), start=1):
        stripped = line.strip()
        if stripped.startswith("["):
            names = stripped.partition("]")[0].strip("[ ").split(".")
            if stripped.startswith("[["):
                arrays[".".join(names)] += 1
            path = table = _indexed(names, arrays)
        else:
            path = [*table, *stripped.split("=")[0].strip().split(".")]
        depth = len(path) if path == keys[: len(path)] else 0
        if depth > best_depth:
            best, best_depth = number, depth
    return best


def _indexed(names: list[str], arrays: Counter[str]) -> list[str]:
    """Return the keys of a table; arrays: how many tables each array of tables has so far."""
    keys = []
    for depth, name in enumerate(names, start=1):
        keys.append(name)
        if place := arrays[".".join(names[:depth])]:
            keys.append(str(place - 1))
    return keys
