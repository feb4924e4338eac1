"""What is said of the keys of a bench file."""

import pytest

from motord.config import Config, InverterConfig, LimitsConfig, ModbusConfig, Section
from motord.config.base import Finite
from motord.config.text.descriptions import description, field_of, section_of, summary


class Base(Section):
    """`[base]`: what it is.

    c_A: current. d_V is a voltage; e is
    nothing.
    """

    a: int = 1
    """The first,
    of two lines."""
    b: int = 2
    c_A: Finite = 0.0
    d_V: Finite = 0.0


class Derived(Base):
    f: str = ""
    """Of its own."""


@pytest.mark.parametrize(
    ("name", "expected"),
    [("a", "The first, of two lines"), ("b", ""), ("f", "Of its own")],
)
def test_a_key_is_described_by_the_string_below_it(
    name: str, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for cls in (Base, Derived):
        monkeypatch.setattr(cls, "__module__", "motord.test")
    monkeypatch.setattr("inspect.getsource", lambda cls: SOURCES[cls.__name__])
    assert description(Derived, name) == expected


SOURCES = {
    "Base": '''class Base(Section):
    a: int = 1
    """The first,
    of two lines."""
    b: int = 2
''',
    "Derived": '''class Derived(Base):
    f: str = ""
    """Of its own."""
''',
    "Section": "class Section: ...",
}


@pytest.mark.parametrize(
    ("name", "expected"), [("c_A", "current"), ("d_V", "a voltage"), ("b", "")]
)
def test_or_else_by_the_docstring_of_its_section(name: str, expected: str) -> None:
    assert description(Base, name) == expected


def test_what_a_section_is() -> None:
    assert summary(Base) == "What it is."
    assert summary(LimitsConfig).startswith("What the loop never exceeds")


def test_fields_are_found_by_their_whole_key() -> None:
    assert field_of("motor.pole_pairs").annotation is int
    assert section_of(Config.model_fields["inverter"]) is InverterConfig
    assert section_of(field_of("brake.modbus")) is ModbusConfig
    assert section_of(field_of("motor.name")) is None
    for wrong in ("motor.poles", "motors.pole_pairs", "motor.name.x"):
        with pytest.raises(KeyError):
            field_of(wrong)
