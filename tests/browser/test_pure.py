"""The page's parts that need no browser, in Node."""

import shutil
import subprocess
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent
STATIC = FOLDER.parents[1] / "src" / "motord" / "dashboard" / "static"

pytestmark = pytest.mark.skipif(
    shutil.which("node") is None, reason="needs node: apt-get install nodejs npm"
)


def test_in_node():
    files = sorted(map(str, FOLDER.glob("*.test.mjs")))
    done = subprocess.run(["node", "--test", *files], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_nothing_is_fetched_from_elsewhere_and_nothing_is_inline():
    for name in ("index.html", "benches.html"):
        page = (STATIC / name).read_text()
        assert "style=" not in page
        assert "onclick" not in page
        assert page.count("<script") == 1
    for path in [*STATIC.glob("*.js"), *STATIC.glob("*.css")]:
        text = path.read_text().replace("http://www.w3.org/2000/svg", "")
        assert "://" not in text, path.name
        assert "eval(" not in text, path.name
        assert "innerHTML" not in text, path.name
