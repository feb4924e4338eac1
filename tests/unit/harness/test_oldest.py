"""`make oldest` installs by name what the unit tests want besides motord's own dependencies."""

import ast
import re
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
SHARED = (ROOT / "tests" / "conftest.py", *(ROOT / "tests" / "support").glob("*.py"))
"""What every run imports, or most of them."""


def normalized(requirement: str) -> str:
    """Return the name of a requirement as PEP 503 compares it."""
    return re.sub(r"[-_.]+", "-", re.split(r"[\[<>=!~ ;]", requirement)[0]).lower()


def installed_by_name() -> set[str]:
    """Return the packages that the tool names for the tests."""
    [line] = re.findall(r"--constraint \S+ (.*)", (ROOT / "tools" / "oldest").read_text())
    return {normalized(name) for name in line.split()}


def imported() -> set[str]:
    """Return the packages that the shared modules of the tests import, wherever they do."""
    modules = set()
    for path in SHARED:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                modules |= {one.name.partition(".")[0] for one in node.names}
            elif isinstance(node, ast.ImportFrom):
                modules.add((node.module or "").partition(".")[0])
    known = packages_distributions()
    others = modules - set(sys.stdlib_module_names) - {"motord", "tests"}
    return {normalized(known[module][0]) for module in others}


def test_what_the_tests_import_is_installed() -> None:
    extras = [one for extra in PROJECT["optional-dependencies"].values() for one in extra]
    own = {normalized(one) for one in (*PROJECT["dependencies"], *extras)}
    assert imported() <= own | installed_by_name()


def test_what_the_options_of_pytest_need_is_installed() -> None:
    """pytest refuses an option that none of its plugins knows."""
    assert {"pytest-timeout", "pytest-xdist"} <= installed_by_name()
