"""Processes that compute operating points are kept from test to test: each takes seconds to start.

`tests/system/test_demo.py` runs with its own, which end with the command.
"""

import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import pytest


class Kept(ProcessPoolExecutor):
    """A pool that outlives the blocks that use it."""

    def __exit__(self, *_error: object) -> None:
        pass


@pytest.fixture(scope="session")
def kept_pools() -> Iterator[list[Kept]]:
    pools: list[Kept] = []
    yield pools
    for pool in pools:
        pool.shutdown()


@pytest.fixture(autouse=True)
def kept_processes(kept_pools: list[Kept], monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = sys.modules.get("motord.virtual.mesh")
    if mesh is None:
        return

    def kept(workers: int, context: Any) -> Kept:
        if not kept_pools:
            kept_pools.append(Kept(workers, context))
        return kept_pools[0]

    monkeypatch.setattr(mesh, "ProcessPoolExecutor", kept)
