"""What a recording says of itself."""

from importlib.metadata import PackageNotFoundError, version

import pytest

from motord import config
from motord.recording import metadata


@pytest.mark.parametrize("error", [PackageNotFoundError("numba"), OSError(2, "gone")])
def test_a_package_that_was_removed_meanwhile_has_no_version(monkeypatch, error):
    def version_of(name):
        if name == "numba":
            raise error
        return version(name)

    monkeypatch.setattr(metadata, "version", version_of)
    monkeypatch.setattr(metadata, "_installed", metadata._installed.__wrapped__)  # asked anew
    versions = metadata.describe(config.load(), "")["versions"]
    assert versions["numba"] == ""
    assert all(text for name, text in versions.items() if name != "numba")
