"""Which drivers the contract is held against: this project's, or those that an option names."""

from importlib import import_module
from typing import Any

import pytest

OPTIONS = {"--fast-driver": "Bench", "--setpoint-device": "Pair"}


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("motord", "the contract of drivers")
    for name, what in OPTIONS.items():
        group.addoption(
            name,
            action="append",
            default=[],
            metavar="MODULE:FUNCTION",
            help=f"hold the contract against what this function makes (a {what}), not our own",
        )


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Let each test of the contract run with every driver that it is about."""
    from tests.contract import benches, test_setpoint_devices

    ours = {
        "fast_bench": ("--fast-driver", benches.BENCHES),
        "wired_bench": ("--fast-driver", benches.ON_A_WIRE),
        "refusing_bench": ("--fast-driver", benches.REFUSING),
        "bus_bench": ("--fast-driver", benches.GOING_OFF),
        "make_pair": ("--setpoint-device", test_setpoint_devices.DEVICES),
    }
    for name in ours.keys() & set(metafunc.fixturenames):
        option, makes = ours[name]
        chosen = named(metafunc.config, option) or list(makes)
        metafunc.parametrize(name, chosen, ids=[make.__name__ for make in chosen])


def named(config: pytest.Config, option: str) -> list[Any]:
    """Return the functions that an option names, may be none. Raises UsageError."""
    found = []
    for target in config.getoption(option, default=[]):
        module, _, name = target.partition(":")
        try:
            found.append(getattr(import_module(module), name))
        except (ImportError, AttributeError, ValueError) as error:
            raise pytest.UsageError(f"{option}={target}: {error}") from error
    return found
