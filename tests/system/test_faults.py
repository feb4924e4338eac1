"""Faults on the wire: a few of the campaign's; detected, current off, enabled again, none lost."""

import json

import pytest

from motord.cli import app
from motord.config import load
from motord.emulate import EmulatorError
from motord.emulate.control import inject
from tests.campaigns.fault_wire import FEW, WIRE_TABLE, session, wrong
from tests.system.daemons import emulator, runtime_of
from tests.unit.emulate.benches import write_bench

pytestmark = [pytest.mark.system, pytest.mark.slow]


@pytest.mark.long
def test_a_few_faults_under_torque(tmp_path):
    rows = tuple(row for row in WIRE_TABLE if row.fault.kind in FEW)
    outcomes = session(tmp_path, rows, ("torque",))
    assert len(outcomes) == len(rows)
    assert not [(one.row.fault.kind, wrong(one)) for one in outcomes if wrong(one)]


def test_faults_by_command_and_what_cannot_be(tmp_path):
    from typer.testing import CliRunner

    bench = write_bench(tmp_path)
    with runtime_of(tmp_path), emulator(tmp_path, bench, tmp_path / "truth.mcap"):
        run = CliRunner().invoke
        said = run(app, ["fault", "inject", "-c", str(bench), "can_drop", "fraction=0.5"])
        assert said.exit_code == 0
        assert said.stdout.startswith("injected: can_drop for 0.3 s, fraction 0.5")
        said = run(app, ["fault", "inject", "-c", str(bench), "can_late", "--json", "--for-s", "2"])
        assert json.loads(said.stdout)["for_s"] == 2.0
        with pytest.raises(EmulatorError, match="no kind of fault"):
            inject(load(bench), {"kind": "gremlins"})
        with pytest.raises(EmulatorError, match="not possible here, only in: virtual"):
            inject(load(bench), {"kind": "supervisor_silent"})
        with pytest.raises(EmulatorError, match="no parameter phase"):
            inject(load(bench), {"kind": "can_drop", "phase": "a"})
    with pytest.raises(EmulatorError, match="start `motord emulate` first"):
        inject(load(bench), {"kind": "can_drop"})
