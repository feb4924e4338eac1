"""How long tests wait for what must come, all of them."""

import time
from collections.abc import Callable
from typing import Any

PATIENCE_S = 120.0
"""For one event on a busy computer. No bound on the product: its times have their own tests."""


def until(condition: Callable[[], Any], what: str = "", look_s: float = 0.02) -> Any:
    """Return what `condition` returns once it is true; fails if it stays false for long."""
    end_s = time.monotonic() + PATIENCE_S
    while not (result := condition()):
        assert time.monotonic() < end_s, f"not within {PATIENCE_S:g} s: {what or condition}"
        time.sleep(look_s)
    return result
