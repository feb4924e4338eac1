"""What a recording says of itself."""

from functools import cache
from importlib.metadata import PackageNotFoundError, version

import pytest

from motord import config
from motord.recording import metadata


@pytest.mark.parametrize("first", [PackageNotFoundError("numba"), OSError(2, "gone"), None])
def test_a_package_that_cannot_be_read_is_asked_for_again_and_keeps_what_it_said(
    monkeypatch, first
):
    """None: of a folder that an upgrade has not filled yet."""
    answers = [first, "1.0", "2.0"]

    def version_of(name):
        if name != "numba":
            return version(name)
        answer = answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    monkeypatch.setattr(metadata, "version", version_of)
    monkeypatch.setattr(metadata, "_installed", cache(metadata._installed.__wrapped__))
    bench = config.load()
    named = [metadata.describe(bench, "")["versions"] for _ in range(3)]
    assert [versions["numba"] for versions in named] == ["", "1.0", "1.0"]
    assert all(text for name, text in named[0].items() if name != "numba")
