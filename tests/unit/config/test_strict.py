"""No field of any file of ours takes a value of another type: every section, every field."""

import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from motord.config import Config, ConfigError, Section, load
from motord.config.experiments import plans_model
from motord.config.text.descriptions import section_of

WRONG: dict[str, tuple[Any, ...]] = {
    "integer": ("8", "", 8.0, 8.5, True, False, None, b"8"),
    "number": ("8", "1e3", "nan", True, False, None, b"8"),
    "boolean": (0, 1, 1.0, "true", "yes", "on", "1", None),
    "string": (8, 1.5, True, b"text", None),
}
"""Values that are not of a JSON type, though they could be made into one."""


SOURCE = Path(__file__).parents[3] / "src"
CLASS = re.compile(r"^class (\w+)\(([^)]*)\)", re.MULTILINE)


def modules_of_sections() -> set[str]:
    """Return the modules that define sections, by their text: which are loaded depends on order."""
    defined = [
        (name, set(re.findall(r"\w+", bases)), module_of(path))
        for path in SOURCE.rglob("*.py")
        for name, bases in CLASS.findall(path.read_text())
    ]
    known, before = {"Section"}, 0
    while len(known) > before:
        before = len(known)
        known |= {name for name, bases, _ in defined if bases & known}
    return {module for name, _, module in defined if name in known}


def module_of(path: Path) -> str:
    return ".".join(path.relative_to(SOURCE).with_suffix("").parts).removesuffix(".__init__")


for module in sorted(modules_of_sections()):
    import_module(module)
plans_model()  # makes the sections of the registered plans


def sections(base: type[Section] = Section) -> Iterator[type[Section]]:
    for kind in base.__subclasses__():
        if kind.__module__.startswith("motord."):
            yield kind
            yield from sections(kind)


def types_of(schema: Any) -> set[str]:
    """Return the JSON types that a field may have, "" for one that is a section or a list."""
    if "anyOf" in schema:
        return {kind for option in schema["anyOf"] for kind in types_of(option)}
    if "const" in schema or "enum" in schema:
        return set()
    return {schema.get("type", "")}


def wrong_values(schema: Any) -> list[Any]:
    """Return values that a field of this JSON schema must not take."""
    types = types_of(schema)
    wrong = [value for name in types & WRONG.keys() for value in WRONG[name]]
    if "array" in types:
        options = schema.get("anyOf", [schema])
        for option in options:
            items = option.get("items") or next(iter(option.get("prefixItems", ())), {})
            wrong += [[value] * option.get("minItems", 1) for value in wrong_values(items)]
        wrong += ["1,2", 7]
    right = [one for name in types & WRONG.keys() for one in _right(name)]
    if "null" in types:
        right.append(None)
    return [value for value in wrong if not any(_same(value, one) for one in right)]


def _right(name: str) -> tuple[Any, ...]:
    text = ("8", "", "1e3", "nan", "true", "yes", "on", "1", "text", "1,2")
    return {"integer": (8, 0, 1), "number": (8, 8.0, 8.5, 0, 1, 1.0, 1.5, 7), "string": text}.get(
        name, (True, False)
    )


def _same(value: Any, other: Any) -> bool:
    return type(value) is type(other) and value == other


SECTIONS = sorted(set(sections()), key=lambda kind: (kind.__module__, kind.__name__))


def refuses(kind: type[Section], name: str, value: Any) -> bool:
    """Return whether a section says of a field that it cannot have a value."""
    try:
        kind.model_validate({name: value})
    except ConfigError:
        return True
    except ValidationError as error:
        return name in {str(one["loc"][0]) for one in error.errors() if one["loc"]}
    return False


@pytest.mark.parametrize("kind", SECTIONS, ids=lambda kind: kind.__name__)
def test_no_field_takes_another_type(kind: type[Section]) -> None:
    schemas = kind.model_json_schema(by_alias=False)["properties"]
    files = {name for name in kind.model_fields if schemas[name].get("format") == "path"}
    if kind.__name__ == "MotorConfig":
        files.add("back_emf")
    for name in kind.model_fields:
        for value in wrong_values(schemas[name]):
            a_file = name in files and isinstance(value, str)
            assert a_file or refuses(kind, name, value), f"{name} takes {value!r}"


def test_every_section_of_a_bench_is_walked() -> None:
    assert {section_of(field) for field in Config.model_fields.values()} <= set(SECTIONS)
    assert sum(len(kind.model_fields) for kind in SECTIONS) > 250


@pytest.mark.parametrize("wrong", ['"8"', "8.0", "true"])
def test_a_bench_file_with_text_for_a_number_is_refused_with_line_and_value(
    tmp_path: Path, wrong: str
) -> None:
    path = tmp_path / "bench.toml"
    text = (Path(__file__).parents[3] / "src/motord/data/sim.toml").read_text()
    assert "pole_pairs = 8\n" in text
    path.write_text(text.replace("pole_pairs = 8\n", f"pole_pairs = {wrong}\n"))
    with pytest.raises(ConfigError, match=r"bench.toml:\d+: motor.pole_pairs: .*integer.*got"):
        load(path)


def test_a_whole_number_is_good_for_a_float() -> None:
    bench = load().model_dump()
    bench["limits"]["torque_Nm"] = 5
    assert Config.model_validate(bench).limits.torque_Nm == 5.0
