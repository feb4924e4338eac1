"""`motord check` of a bench whose devices answer, but not with what it takes to run."""

from types import SimpleNamespace
from typing import Any

import pytest

from motord.cli.check import probe_devices
from motord.config import load
from motord.schema import BridgeStatus


@pytest.mark.parametrize("bit", [BridgeStatus.FAULT, BridgeStatus.BARRED])
def test_a_board_that_keeps_its_line_open_is_not_ready(
    monkeypatch: pytest.MonkeyPatch, bit: BridgeStatus
) -> None:
    def read(now_ns: int, feedback: Any) -> None:
        feedback["bridge_status"] = bit

    rig = SimpleNamespace(open=lambda: None, read=read, close=lambda: None)
    monkeypatch.setattr("motord.hal.registry.make_rig", lambda bench: rig)
    found = next(one for one in probe_devices(load()) if one["what"] == "inverter and bridge")
    assert not found["ok"]
    assert "bridge board" in found["message"]
