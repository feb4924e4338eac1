"""Pages without a browser, and subscribers to every tick, beside a daemon: what they saw, as JSON.

Connects, says "ready", goes on until its standard input ends, and prints what came meanwhile.
"""

import asyncio
import json
import sys
import time
from dataclasses import asdict, dataclass, field

import numpy as np
from websockets.asyncio.client import connect

from motord.client import connect as connect_to_daemon
from motord.dashboard.frames import decode, encode

SIGNALS = (
    "torque_Nm", "torque_set_Nm", "i_a_A", "i_b_A", "i_c_A", "speed_Hz", "speed_set_Hz",
    "angle_rad",
)  # fmt: skip
SPAN_S, BUCKETS = 10.0, 1200


@dataclass
class Seen:
    """What a page received: bytes, frames with traces, delays from sample to frame (s), losses."""

    bytes: int = 0
    frames: int = 0
    delays_s: list[float] = field(default_factory=list)
    lost: int = 0


class PageClient:
    """One page: a live view of the usual signals."""

    def __init__(self, url: str, origin: str, token: str) -> None:
        self._url, self._origin, self._token = url, origin, token
        self.seen = Seen()
        self.ready = asyncio.Event()

    async def run(self) -> None:
        """Receive until cancelled."""
        async with connect(
            self._url, subprotocols=["motord.1", self._token], origin=self._origin,
            max_size=None, compression=None,
        ) as socket:  # fmt: skip
            view = {"view": 1, "span_s": SPAN_S, "end_s": None, "buckets": BUCKETS}
            await socket.send(encode({"kind": "view", "signals": SIGNALS, **view}))
            epoch_s, newest_s = 0.0, 0.0
            async for message in socket:
                header, floats = decode(message)
                self.seen.bytes += len(message)
                if header["kind"] == "ping":
                    await socket.send(encode({"kind": "pong", "n": header["n"]}))
                elif header["kind"] == "hello":
                    epoch_s = header["epoch_ns"] / 1e9
                elif header["kind"] == "trace":
                    before_s, newest_s = newest_s, _newest_s(header, floats)
                    self._frame(header, epoch_s + (before_s + newest_s) / 2)

    def _frame(self, header: dict, middle_s: float) -> None:
        """Note a frame whose new ticks were sampled about `middle_s` (Unix)."""
        seen = self.seen
        seen.lost = header["lost"]
        if header["whole"]:
            self.ready.set()
            return
        seen.frames += 1
        seen.delays_s.append(time.time() - middle_s)


def _newest_s(header: dict, floats: np.ndarray) -> float:
    there = np.flatnonzero(np.isfinite(floats[: header["buckets"]]))
    return header["t0_s"] + (there[-1] if len(there) else 0) * header["dt_s"]


async def main() -> None:
    """Run pages and subscribers: `URL ORIGIN TOKEN PAGES BENCH ENDPOINT SUBSCRIBERS`."""
    url, origin, token, pages, bench, endpoint, subscribers = sys.argv[1:]
    clients = [PageClient(url, origin, token) for _ in range(int(pages))]
    tasks = [asyncio.create_task(client.run()) for client in clients]
    daemons = [connect_to_daemon(bench, endpoint) for _ in range(int(subscribers))]
    counts: list[int] = []
    subscriptions = [
        daemon.subscribe_ticks(lambda block: counts.append(len(block))) for daemon in daemons
    ]
    for client in clients:
        await client.ready.wait()
    print("ready", flush=True)  # noqa: T201
    await asyncio.to_thread(sys.stdin.read)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    for subscription in subscriptions:
        subscription.close()
    for daemon in daemons:
        daemon.close()
    print(json.dumps({"pages": [asdict(c.seen) for c in clients], "ticks": sum(counts)}))  # noqa: T201


if __name__ == "__main__":
    asyncio.run(main())
