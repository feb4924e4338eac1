"""The contract finds what is broken: each mutant by the tests that are named with it."""

import inspect
import math
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

import pytest

from tests.contract import ideal, mutants, test_fast_drivers, test_setpoint_devices
from tests.contract.ideal import Bridge, Inverter, Slow, SlowEnd
from tests.contract.mutants import FAST, SLOW, Mutant
from tests.contract.test_setpoint_devices import Pair
from tests.support import patience

WILD = (math.nan, math.inf, -math.inf)
PHASES = range(3)


@pytest.fixture(autouse=True)
def no_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait for nothing: what these drivers do they have done when they return."""
    monkeypatch.setattr(patience, "PATIENCE_S", 0.0)


def promises(module: ModuleType) -> dict[str, Callable[..., None]]:
    return {name: test for name, test in vars(module).items() if name.startswith("test_")}


def cases(test: Callable[..., None]) -> Iterator[dict[str, Any]]:
    """Return the arguments other than the driver that pytest would call a test with."""
    names = inspect.signature(test).parameters
    for wild in WILD if "wild" in names else (None,):
        for phase in PHASES if "phase" in names else (None,):
            both = {"wild": wild, "phase": phase}
            yield {name: value for name, value in both.items() if name in names}


def hold(test: Callable[..., None], kind: type) -> None:
    """Call a test of the contract with drivers of this class, as pytest would."""
    for others in cases(test):
        if issubclass(kind, Slow):
            end = SlowEnd()
            slow = kind(end)
            vanish = lambda end=end: setattr(end, "gone", True)  # noqa: E731
            try:
                test(Pair(slow, lambda end=end: end.setpoint, end.measure, vanish), **others)
            finally:
                Slow.close(slow)
            continue
        bench = ideal.bench(kind)
        try:
            if "closed" not in inspect.signature(test).parameters:
                bench.driver.open()
            test(bench, **others)
        finally:
            ideal.Driver.close(bench.driver)


def is_about(test: Callable[..., None], kind: type) -> bool:
    return kind is not Bridge or "bus" not in inspect.signature(test).parameters


def found(test: Callable[..., None], kind: type) -> bool:
    try:
        hold(test, kind)
    except (Exception, pytest.fail.Exception):
        return True
    return False


@pytest.mark.parametrize("kind", [Inverter, Bridge, Slow], ids=lambda kind: kind.__name__)
def test_a_driver_without_fault_passes(kind: type) -> None:
    module = test_setpoint_devices if kind is Slow else test_fast_drivers
    for test in promises(module).values():
        if is_about(test, kind):
            hold(test, kind)


@pytest.mark.parametrize("mutant", FAST, ids=lambda mutant: mutant.what.replace(" ", "_"))
def test_a_broken_fast_driver_is_found(mutant: Mutant) -> None:
    tests = promises(test_fast_drivers)
    for kind in mutant.classes():
        assert [name for name in mutant.found_by if not found(tests[name], kind)] == []


@pytest.mark.parametrize("mutant", SLOW, ids=lambda mutant: mutant.what.replace(" ", "_"))
def test_a_broken_setpoint_device_is_found(mutant: Mutant) -> None:
    tests = promises(test_setpoint_devices)
    for kind in mutant.classes():
        assert [name for name in mutant.found_by if not found(tests[name], kind)] == []


@pytest.mark.parametrize(
    ("module", "table"), [(test_fast_drivers, FAST), (test_setpoint_devices, SLOW)]
)
def test_no_promise_is_without_a_driver_that_breaks_it(
    module: ModuleType, table: tuple[Mutant, ...]
) -> None:
    finding = {name for mutant in table for name in mutant.found_by}
    assert finding == set(promises(module))


def test_mutants_differ() -> None:
    """From the driver without fault, and one from another."""
    for table in (mutants.FAST, mutants.SLOW):
        named = [(mutant.what, kind) for mutant in table for kind in mutant.kinds]
        assert len(set(named)) == len(named)
