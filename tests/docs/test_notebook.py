"""docs/notebook.md is what docs/notebook.py gives; that the script runs shows test_run.py."""

import pytest
from tools import notebook


def test_the_page_is_that_of_the_script() -> None:
    assert notebook.main(["--check"]) == 0
    for name in notebook.pictures(notebook.PAGE.read_text()):
        assert (notebook.IMAGES / name).exists()


@pytest.mark.parametrize(
    ("there", "here"),
    [
        ("TURNS = 4", "TURNS = 5"),  # code
        ("## Connect", "## Disconnect"),  # prose
        ("](images/notebook-3.png)", "](images/notebook-4.png)"),
    ],
)
def test_another_page_is_found(there: str, here: str) -> None:
    script, page = notebook.SCRIPT.read_text(), notebook.PAGE.read_text()
    assert there in page
    assert list(notebook.errors(script, page.replace(there, here, 1)))


def test_what_cells_print_may_differ() -> None:
    script, page = notebook.SCRIPT.read_text(), notebook.PAGE.read_text()
    assert "Nm RMS" in page
    assert not list(notebook.errors(script, page.replace("ripple 0", "ripple 1")))
