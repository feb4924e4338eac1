"""Commands that serve viewers, without what they serve."""

import os
from contextlib import nullcontext
from types import SimpleNamespace

from typer.testing import CliRunner

from motord import client
from motord.cli import app
from motord.dashboard import server


def test_a_page_connects_again_to_the_bench_that_it_shows_and_to_no_other(monkeypatch):
    asked = []

    def connect(bench, endpoint, identity):
        asked.append(bench)
        return nullcontext(SimpleNamespace(bench="rig-1", identity=None))

    monkeypatch.setattr(client, "connect", connect)
    monkeypatch.setattr(os, "nice", lambda by: 0)
    monkeypatch.setattr(server, "serve", lambda client, again, listener, tokens: again())
    done = CliRunner().invoke(app, ["dashboard", "--no-browser", "--port", "0"])
    assert done.exit_code == 0, done.output
    assert asked == [None, "rig-1"]
