"""Anything comes in, with the address and undefined-behaviour sanitizers watching."""

from pathlib import Path

import pytest

from tests.firmware.library import C_TESTS, FLAGS, HOST_SOURCE, needs, run, sources

SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")


@pytest.fixture(scope="module")
def fuzz(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("sanitized") / "fuzz"
    run(
        needs("gcc", "gcc"), *FLAGS, *SANITIZERS, "-O1", "-g", "-o", out, *sources(), HOST_SOURCE,
        C_TESTS / "fuzz.c",
    )  # fmt: skip
    return out


@pytest.mark.parametrize("seed", range(4))
def test_nothing_that_comes_in_does_harm(fuzz: Path, seed: int) -> None:
    steps = 200_000
    closed = int(run(fuzz, seed, steps).stdout)
    assert closed > steps // 20  # the line was closed now and then, so there was something to see


def test_interrupts_and_main_loop_share_nothing_unguarded(tmp_path: Path) -> None:
    """As two threads, under the thread sanitizer; no frame is torn, lost or out of order."""
    out = tmp_path / "threads"
    run(
        needs("gcc", "gcc"), *FLAGS, "-D_POSIX_C_SOURCE=200809L", "-fsanitize=thread", "-O1", "-g",
        "-pthread", "-o", out, *sources(), HOST_SOURCE, C_TESTS / "threads.c",
    )  # fmt: skip
    samples = 50_000
    wrong, arrived, dropped = map(int, run(out, samples).stdout.split())
    assert wrong == 0
    assert arrived + dropped == samples
    assert arrived > 100
