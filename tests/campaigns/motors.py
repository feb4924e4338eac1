"""Motors in series on the emulated bench: `python -m tests.campaigns.motors [--out FOLDER]`.

Three motors, of which only the 48th order of the cogging torque differs, are put on the bench of
config/emulated.toml one after the other and tested by `motord test` in real time: one within the
limit, one beyond it, one so near to it that the measurement cannot decide. Leaves certificates, the
results store, a control chart and the answer to a question in SQL in FOLDER. Exits with 1 if a
verdict is not the one that the motor must get.
"""

import argparse
import subprocess
import sys
from pathlib import Path

from motord.config import packaged
from tests.support.ports import free_port
from tests.system.daemons import daemon, emulator, runtime_of, wait_for
from tests.unit.emulate.benches import write_bench

LIMIT_NM = 0.35
COGGING = "order = 48, amplitude_Nm = "
MOTORS = {"good-1": (0.32, 0), "bad-1": (0.41, 3), "near-1": (LIMIT_NM, 4)}
"""Serial number to true amplitude of the 48th order (Nm) and exit code of `motord test`."""

TYPE = f"""\
motor = "axial-flux 48/16"
risk_percent = 2.5

[[plan]]
name = "calibrate"
settings = {{time_limit_s = 30.0}}

[[limit]]
analysis = "calibrate"
figure = "alpha"
low = 0.7
high = 1.2

[[limit]]
analysis = "calibrate"
figure = "cogging_Nm"
at = {{order = 48}}
unit = "Nm"
high = {LIMIT_NM}
"""


def motord(folder: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, in a folder."""
    command = [sys.executable, "-m", "motord", *map(str, arguments)]
    return subprocess.run(command, cwd=folder, text=True, capture_output=True, check=False)


def tested(out: Path, serial: str, cogging_Nm: float) -> subprocess.CompletedProcess[str]:
    """Put a motor on an emulated bench, test it, and store its results in `out`."""
    folder = out / serial
    folder.mkdir()
    rig = packaged("report.rig.toml").read_text()
    assert rig.count(f"{COGGING}0.33") == 1
    (folder / "rig.toml").write_text(rig.replace(f"{COGGING}0.33", f"{COGGING}{cogging_Nm}"))
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    changes = {
        '"package:report.rig.toml"': '"rig.toml"',
        'serial = "sim-1"': 'serial = ""',
        "[zenoh]\n": f'[zenoh]\nlisten = ["{endpoint}"]\n',
    }
    bench = write_bench(folder, changes)
    with (
        runtime_of(folder),
        emulator(folder, bench, folder / "truth.mcap"),
        daemon(folder, bench) as running,
    ):
        with running.connect() as client:
            wait_for(client, lambda state: not state.trips, "samples of all devices")
        ended = motord(
            out, "test", "pump.toml", "--serial", serial, "--store", "store",
            "--certificate", f"{serial}.html", "--connect", endpoint,
        )  # fmt: skip
        assert running.end() == 0, running.said()
    return ended


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("motors"), help="where the files go")
    out = parser.parse_args().out.resolve()
    out.mkdir(parents=True)
    (out / "pump.toml").write_text(TYPE)
    wrong = 0
    for serial, (cogging_Nm, code) in MOTORS.items():
        ended = tested(out, serial, cogging_Nm)
        print(f"{serial}: {cogging_Nm} Nm, limit {LIMIT_NM} Nm: exit code {ended.returncode}")
        print(ended.stdout + ended.stderr, flush=True)
        wrong += ended.returncode != code
    amplitude = "tau_cog_harmonics.48.amplitude_Nm"
    questions = (
        ("query", f"SELECT serial, value, stderr FROM results WHERE field = '{amplitude}'"),
        ("trend", amplitude, "--by", "motor", "-o", "trend.svg"),
    )
    for question in questions:
        ended = motord(out, "results", *question, "--store", "store")
        print(ended.stdout + ended.stderr)
        wrong += ended.returncode != 0
    print(f"{len(MOTORS)} motors, {wrong} verdicts or answers wrong")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
