"""What source says of the values of a `Literal`, and the first lines of docstrings."""

import ast
import inspect
from types import ModuleType

from motord.attribute_docs import comments_by_line


def described_values(module: ModuleType, name: str) -> dict[str, str]:
    """Return the values of the `Literal` that a module calls `name`, with the comments on them."""
    source = inspect.getsource(module)
    comments = comments_by_line(source)
    for node in ast.parse(source).body:
        match node:
            case ast.Assign(targets=[ast.Name(target)]) if target == name:
                return {
                    value.value: comments.get(value.lineno, "")
                    for value in ast.walk(node)
                    if isinstance(value, ast.Constant) and isinstance(value.value, str)
                }
    raise LookupError(f"{module} has no {name}")


def summary(cls: type) -> str:
    """Return the docstring of a class, without the name of the table that it begins with."""
    paragraphs = inspect.cleandoc(cls.__doc__ or "").split("\n\n")
    text = "\n\n".join(" ".join(part.split()) for part in paragraphs)
    text = text.partition("`: ")[2] or text
    return text[:1].upper() + text[1:]
