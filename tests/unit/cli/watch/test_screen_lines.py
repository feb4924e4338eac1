"""Which cells of a line are drawn anew."""

import pytest
from rich.text import Text


@pytest.mark.parametrize(
    ("before", "after", "cells"),
    [
        (Text("3.01 Nm"), Text("3.01 Nm"), None),
        (Text("3.01 Nm"), Text("3.12 Nm"), (2, 4)),
        (Text("abc"), Text("abcde"), (3, 5)),
        (Text("abcde"), Text("abc"), (3, 5)),
        (Text("abc"), Text("abc", "bold"), (0, 3)),
        (Text("abc"), Text.assemble("a", ("bc", "bold")), (0, 3)),
        (Text("日本"), Text("日x"), (0, 4)),  # not one cell a character
        (Text(""), Text(""), None),
        (Text("abc "), Text("abc"), None),
    ],
)
def test_cells_that_changed(before, after, cells):
    from motord.cli.bench.watch.app import changed_cells  # 0.2 s, of whoever collects

    assert changed_cells(before, after) == cells
