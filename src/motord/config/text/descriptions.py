"""What the keys of a bench file mean, for people: from the models themselves."""

import inspect
import re

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from motord.attribute_docs import described
from motord.config.base import Section
from motord.config.bench import Config
from motord.config.experiments import PlansConfig, plans_model


def section_of(field: FieldInfo) -> type[BaseModel] | None:
    """Return the section that a key holds, also one that may be left out; None for a value."""
    for kind in (field.annotation, *getattr(field.annotation, "__args__", ())):
        if kind is PlansConfig:
            return plans_model()
        if inspect.isclass(kind) and issubclass(kind, Section):
            return kind
    return None


def field_of(key: str) -> FieldInfo:
    """Return the field of a key such as `inverter.can.channel`. Raises KeyError."""
    *tables, name = key.split(".")
    section: type[BaseModel] = Config
    for table in tables:
        inner = section_of(section.model_fields[table])
        if inner is None:
            raise KeyError(table)
        section = inner
    return section.model_fields[name]


def summary(section: type[BaseModel]) -> str:
    """Return what a section is: the first line of its docstring, without the name in front."""
    first = inspect.cleandoc(section.__doc__ or "").split("\n", 1)[0]
    text = re.sub(r"^`\[[^:]*: ", "", first)
    return text[:1].upper() + text[1:]


def description(section: type[BaseModel], name: str) -> str:
    """Return what a key means, "" if nothing says so.

    The field's description, or the string below it in the source, or what the docstring of the
    section says of it.
    """
    own = section.model_fields[name].description or described(section).get(name, "")
    return " ".join(own.split()).removesuffix(".") or _in_docstring(section, name)


def _in_docstring(section: type[BaseModel], name: str) -> str:
    paragraphs = inspect.cleandoc(section.__doc__ or "").split("\n\n")[1:]
    clauses = re.split(r"(?<=[.;])\s+", " ".join(" ".join(paragraphs).split()))
    about = re.compile(rf"`?{re.escape(name)}`?:?( is)? (.*?)[.;]?")
    return next((found[2] for one in clauses if (found := about.fullmatch(one))), "")
