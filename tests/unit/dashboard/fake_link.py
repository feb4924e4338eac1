"""A daemon as the server of the page sees it, without a connection."""

import time

from motord import config
from motord.client import ClientError
from motord.dashboard.bench_link import Connectivity

LEASE_S = 60.0


class FakeLink:
    """Answers requests, and notes them; one lease, which runs out by the clock."""

    def __init__(self):
        self.calls = []
        self.errors = {}
        """By RPC: what it is refused with."""
        self.alive = True
        self.harmonics = []
        self.holder, self.until_s, self.token = None, 0.0, ""
        self.take = None

    def start(self, take):
        self.take = take

    async def keep(self, connected):
        self.connected = connected

    def connectivity(self):
        return Connectivity(self.alive, 0.05, "" if self.alive else "the daemon is gone")

    async def look(self, method):
        return [] if method == "events" else None

    async def call(self, name, /, *, urgent=False, **arguments):
        self.calls.append((name, arguments))
        if name in self.errors:
            raise self.errors[name]
        if name == "config":
            return {"toml": "", "config": config.load().model_dump(mode="json")}
        if name == "calibration/show":
            return {"tau_cog_harmonics": self.harmonics}
        if name.startswith("lease/"):
            return self._lease(name, arguments)
        return {"state": "READY"}

    def named(self, name):
        """Return the arguments of all calls of an RPC."""
        return [arguments for called, arguments in self.calls if called == name]

    def _lease(self, name, arguments):
        now_s = time.monotonic()
        held = now_s < self.until_s
        if name == "lease/acquire":
            if held and not arguments["force"]:
                raise ClientError("lease_held", f"{self.holder} is in command")
            self.token = f"secret {len(self.calls)}"
            self.holder = arguments["holder"]
        elif not held or arguments["token"] != self.token:
            raise ClientError("no_lease", "the lease is over")
        self.until_s = 0.0 if name == "lease/release" else now_s + LEASE_S
        terms = {"lease_s": LEASE_S, "renew_within_s": LEASE_S / 2}
        return {"token": self.token, "holder": "", "took_over_from": None, **terms}
