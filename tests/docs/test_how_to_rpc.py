"""docs/how-to/add-an-rpc.md: its blocks are put where it says, checked by mypy, and called."""

import os
import re
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from tests.docs.blocks import ROOT

PAGE = ROOT / "docs" / "how-to" / "add-an-rpc.md"
EDIT = re.compile(r"^In `(\S+)`, (before|after) `([^`\n]*)`:\n\n```python\n(.*?)^```$", re.M | re.S)

CALL = """
import json
import numpy as np
from motord import config
from motord.api.errors import RpcError
from motord.api.requests import RPCS, parse
from motord.client.decoding import decode_reply
from motord.schema import TICK_DTYPE
from motord.service.bench.bench import Bench
from motord.service.host.events import EventLog
from motord.service.rpc.dispatcher import Call, Dispatcher
from motord.service.rpc.operation import ManualOperation

bench = Bench(config.load(), None, {}, EventLog(lambda: 42), None)
dispatcher = Dispatcher(bench, ManualOperation(bench, lambda: None, lambda: None))

def ask(**fields):
    replies = []
    request = parse(RPCS["mounted"], json.dumps(fields).encode())
    dispatcher.handle(Call("mounted", request, on_reply=replies.append), 0)
    return replies[0]

token = bench.lease.acquire("anna", 0).token
assert RPCS["mounted"].needs_lease
assert ask(token="guess", serial="x").code == "no_lease"
assert ask(token=token, serial="x").code == "refused"
bench.loop.up()
bench.monitor.last = np.zeros(1, TICK_DTYPE)[0]
reply = decode_reply(RPCS["mounted"], ask(token=token, serial="A-17").to_json())
assert reply.content() == {"t_ns": 42}
event = bench.events.recent()[-1]
assert (event.kind, event.message, event.data) == ("mounted", "A-17", {"holder": "anna"})
try:
    ask(token=token, serial="")
except RpcError as error:
    assert error.code == "invalid"
else:
    raise AssertionError("an empty serial number was taken")
"""


@pytest.fixture(scope="module")
def edited(tmp_path_factory):
    """A copy of the package with the page's blocks in it."""
    root = tmp_path_factory.mktemp("rpc")
    skip = shutil.ignore_patterns("*.nbi", "*.nbc")
    shutil.copytree(ROOT / "src", root / "src", ignore=skip)
    shutil.copy(ROOT / "pyproject.toml", root)
    edits = EDIT.findall(PAGE.read_text(encoding="utf-8"))
    assert len(edits) == 5
    for file, where, anchor, block in edits:
        path = root / file
        text = path.read_text(encoding="utf-8")
        lines = re.findall(rf"^ *{re.escape(anchor)}.*\n", text, re.M)
        assert len(lines) == 1, f"{file} has {len(lines)} lines that begin with {anchor!r}"
        margin = lines[0][: len(lines[0]) - len(lines[0].lstrip())]
        block = textwrap.indent(block, margin)
        new = block + lines[0] if where == "before" else lines[0] + block
        path.write_text(text.replace(lines[0], new), encoding="utf-8")
    return root


def run(edited: Path, *command: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(edited / "src")}
    return subprocess.run(
        (sys.executable, *command), cwd=edited, env=environment, capture_output=True, text=True
    )


@pytest.mark.slow
def test_the_rpc_of_the_page_can_be_called(edited):
    done = run(edited, "-c", CALL)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_the_types_of_a_handler_are_those_of_its_row(edited):
    handler = edited / "src/motord/service/rpc/operation.py"
    text = handler.read_text(encoding="utf-8")
    wrong = text.replace("request: rpc.Mounted,", "request: rpc.PlanStart,")
    (handler.parent / "wrong.py").write_text(wrong, encoding="utf-8")
    modules = "-p", "motord.service.rpc.operation", "-p", "motord.service.rpc.wrong"
    done = run(edited, "-m", "mypy", f"--cache-dir={os.devnull}", *modules)
    assert done.returncode == 1, done.stdout
    errors = [line for line in done.stdout.splitlines() if " error: " in line]
    assert errors
    assert all("/rpc/wrong.py:" in error for error in errors), done.stdout
    assert "handles" in done.stdout or "Argument 1" in done.stdout, done.stdout


def test_the_page_names_files_and_functions_that_are_there():
    text = PAGE.read_text(encoding="utf-8")
    for name in re.findall(r"`((?:src/motord|tests|api|service|rpc|security)/[\w/.]+)`", text):
        places = [ROOT / name, ROOT / "src/motord" / name, ROOT / "src/motord/service" / name]
        assert any(place.exists() for place in places), name
