"""What source says of the attributes of a class and the values of a `Literal`.

An attribute is described by the string below it, or by the comment behind it. Both are read from
the source when the pages are made, so that they cost nothing when the program runs.
"""

import ast
import inspect
import io
import textwrap
import tokenize
from functools import cache


@cache
def described(cls: type) -> dict[str, str]:
    """Return the descriptions of the attributes of a class, those of its bases included."""
    found: dict[str, str] = {}
    for each in reversed(cls.__mro__):
        if each.__module__.startswith("motord"):
            found |= _of_source(textwrap.dedent(inspect.getsource(each)))
    return found


def _of_source(source: str) -> dict[str, str]:
    [node] = ast.parse(source).body
    assert isinstance(node, ast.ClassDef)
    comments = _comments(source)
    found = {}
    for statement, below in zip(node.body, [*node.body[1:], None], strict=True):
        match statement:
            case ast.AnnAssign(target=ast.Name(name)) | ast.Assign(targets=[ast.Name(name)]):
                match below:
                    case ast.Expr(ast.Constant(str(text))):
                        found[name] = inspect.cleandoc(text).replace("\n", " ")
                    case _ if comment := comments.get(statement.end_lineno or 0):
                        found[name] = comment
    return found


def _comments(source: str) -> dict[int, str]:
    """Return the comments by their lines."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return {
        token.start[0]: token.string.lstrip("# ")
        for token in tokens
        if token.type == tokenize.COMMENT
    }


def described_values(module: object, name: str) -> dict[str, str]:
    """Return the values of the `Literal` that a module calls `name`, with the comments on them."""
    source = inspect.getsource(module)  # type: ignore[arg-type]
    comments = _comments(source)
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
