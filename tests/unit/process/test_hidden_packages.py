"""Packages that are not loaded because they happen to be installed."""

import subprocess
import sys

import pytest

from motord.process.hidden_packages import hidden

PACKAGE = "wave"
"""Any that nothing here loads."""


def test_a_hidden_package_is_not_installed_until_the_block_ends(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delitem(sys.modules, PACKAGE, raising=False)
    with hidden(PACKAGE), pytest.raises(ImportError):
        import wave
    assert PACKAGE not in sys.modules
    import wave  # noqa: F401


def test_a_loaded_package_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    module = object()
    monkeypatch.setitem(sys.modules, PACKAGE, module)  # type: ignore[arg-type]
    with hidden(PACKAGE):
        assert sys.modules[PACKAGE] is module  # type: ignore[comparison-overlap]
    assert sys.modules[PACKAGE] is module  # type: ignore[comparison-overlap]


def test_several_packages_are_hidden_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    loaded = object()
    monkeypatch.delitem(sys.modules, PACKAGE, raising=False)
    monkeypatch.setitem(sys.modules, "not_there", loaded)  # type: ignore[arg-type]
    with hidden("not_there", PACKAGE):
        assert sys.modules["not_there"] is loaded  # type: ignore[comparison-overlap]
        with pytest.raises(ImportError):
            import wave  # noqa: F401
    assert PACKAGE not in sys.modules


def test_the_emulator_loads_no_web_server_and_no_statistics() -> None:
    """Some 0.3 s of processor time of its start."""
    pytest.importorskip("aiohttp")  # which pymodbus would load
    heavy = {"aiohttp", "asammdf", "pandas"}
    script = f"import sys, motord.emulate.process\nprint({heavy} & sys.modules.keys())"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout == "set()\n", done.stderr
