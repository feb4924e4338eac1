"""Descriptions of the attributes of classes, read from their source when they are asked for.

An attribute is described by the string below it, or by the comment behind it. So a description
costs nothing where nobody asks for it.
"""

import ast
import inspect
import io
import textwrap
import tokenize
from functools import cache


@cache
def described(cls: type) -> dict[str, str]:
    """Return the descriptions of the attributes of a class, those of its bases included.

    None of classes whose source is not there.
    """
    found: dict[str, str] = {}
    for each in reversed(cls.__mro__):
        if each.__module__.partition(".")[0] not in ("builtins", "pydantic", "typing", "abc"):
            try:
                source = inspect.getsource(each)
            except (OSError, TypeError):  # a package without it, or made when the program runs
                continue
            found |= _of_source(textwrap.dedent(source))
    return found


def _of_source(source: str) -> dict[str, str]:
    [node] = ast.parse(source).body
    assert isinstance(node, ast.ClassDef)
    comments = comments_by_line(source)
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


def comments_by_line(source: str) -> dict[int, str]:
    """Return the comments by their lines."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return {
        token.start[0]: token.string.lstrip("# ")
        for token in tokens
        if token.type == tokenize.COMMENT
    }
