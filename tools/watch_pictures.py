"""Draw `motord watch` on a simulated bench: `python tools/watch_pictures.py [FOLDER]`.

Writes watch.svg (a plan under way) and watch-trip.svg (after a trip) to docs/images. A daemon runs
for it, for a minute and a half; what is on the pictures is what it published.
"""

import asyncio
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from motord import config
from motord.api.messages import BenchState
from motord.cli.bench.watch.app import WatchApp
from motord.cli.bench.watch.feed import Feed
from motord.cli.bench.watch.glyphs import UNICODE
from motord.cli.bench.watch.operator_session import OperatorSession
from motord.client import Client, Commander, connect

IMAGES = Path(__file__).resolve().parent.parent / "docs" / "images"
ENDPOINT = "tcp/127.0.0.1:7457"
RUNNING_S = 58.0
AFTER_TRIP_S = 4.0
WAIT_S = 120.0
TORQUE_Nm = 2.5
"""Without a brake: the rotor speeds up until it trips."""
_FONT_FROM_ELSEWHERE = re.compile(r"@font-face \{.*?\}\s*", re.DOTALL)


def bench_file(folder: Path) -> Path:
    """Write the packaged simulated bench, at 1 kHz and patient with a busy computer."""
    text = config.packaged("sim.toml").read_text()
    text = text.replace('rig = "report.rig.toml"', 'rig = "package:report.rig.toml"')
    text = re.sub(
        r"^(rate_Hz|overrun_ticks|supervisor_timeout_s|spin) = .*\n", "", text, flags=re.M
    )
    settings = "rate_Hz = 1000\noverrun_ticks = 1000\nsupervisor_timeout_s = 1.0\nspin = false\n"
    text = text.replace("[loop]\n", f"[loop]\n{settings}")
    text = re.sub(r"^\[zenoh\]\n(?:[^\[\n].*\n|\n)*", "", text, flags=re.M)
    path = folder / "bench.toml"
    path.write_text(f'{text}\n[zenoh]\nlisten = ["{ENDPOINT}"]\n')
    return path


def wait_for(client: Client, condition: Callable[[BenchState], bool], what: str) -> None:
    """Wait for a state."""
    end_s = time.monotonic() + WAIT_S
    while not condition(client.state()):
        if time.monotonic() > end_s:
            raise SystemExit(f"waited in vain for {what}: {client.state().state}")
        time.sleep(0.1)


async def draw(client: Client, folder: Path) -> None:
    """Run the plan, then trip the bench, and write what is on the screen."""
    session = OperatorSession(client)
    with Feed(client) as feed:
        app = WatchApp(feed, session, UNICODE)
        async with app.run_test(size=(80, 24)) as pilot:
            settings = {
                "torques_Nm": [1.0, 2.0, 3.0, 4.0],
                "speeds_Hz": [0.5, 0.7, 0.9],
                "turns": 6,
            }
            start = partial(Commander.start_plan, name="calibrate", settings=settings, detach=True)
            await asyncio.to_thread(session.command, start)
            await pilot.pause(RUNNING_S * 0.6)
            await asyncio.to_thread(client.note, "brake squeals at 0.7 Hz")
            await pilot.pause(RUNNING_S * 0.4)
            save(app, folder / "watch.svg")
            await asyncio.to_thread(session.command, Commander.abort_plan)
            await asyncio.to_thread(wait_for, client, lambda s: s.state == "READY", "the end")
            turn = partial(Commander.set, enable=True, torque_Nm=TORQUE_Nm)
            await asyncio.to_thread(session.command, turn, keep=True)
            await asyncio.to_thread(wait_for, client, lambda s: s.state == "TRIPPED", "a trip")
            await pilot.pause(AFTER_TRIP_S)
            save(app, folder / "watch-trip.svg")
    session.give()


def save(app: WatchApp, path: Path) -> None:
    """Write the screen, without fonts from other machines."""
    drawn = app.export_screenshot(title="motord watch")
    path.write_text(_FONT_FROM_ELSEWHERE.sub("", drawn).replace("Fira Code", "DejaVu Sans Mono"))


def main(images: Path) -> None:
    """Run a daemon and draw what it does."""
    with tempfile.TemporaryDirectory(prefix="motord-") as name:
        folder = Path(name)
        os.environ.update(XDG_RUNTIME_DIR=name, XDG_STATE_HOME=name, LOGNAME="operator")
        command = [sys.executable, "-m", "motord", "run", "-c", str(bench_file(folder)), "--json"]
        with subprocess.Popen(
            command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        ) as daemon:
            try:
                assert daemon.stdout is not None
                ready = json.loads(daemon.stdout.readline())
                with connect(ready["bench"], ENDPOINT) as client:
                    wait_for(client, lambda s: s.tick is not None, "the loop")
                    asyncio.run(draw(client, images))
            finally:
                daemon.terminate()


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else IMAGES)
