"""`[zenoh]`: where the daemon listens, what it publishes, and who comes in from other machines."""

import re
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from motord import DEFAULT_ENDPOINT
from motord.config.base import Section

PORT_MAX = 65_535
_LOOPBACK = r"tcp/(127\.\d+\.\d+\.\d+|\[::1\]|localhost):\d{1,5}"
_SOCKET = r"unixsock-stream/(?=.{2,100}$)(/[\w.@+-]+)+"
_TLS = r"tls/(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9.-]+):\d{1,5}"


def _closed_to_others(endpoints: tuple[str, ...]) -> tuple[str, ...]:
    own = re.compile(f"{_LOOPBACK}|{_SOCKET}")
    form = re.compile(f"{own.pattern}|{_TLS}")
    if not any(own.fullmatch(endpoint) for endpoint in endpoints) or not all(
        form.fullmatch(endpoint) for endpoint in endpoints
    ):
        raise ValueError(
            "whoever reaches the daemon may command it, so it listens on TCP ports of this "
            'machine alone, such as "tcp/127.0.0.1:7447", or on a Unix socket, such as '
            f'"unixsock-stream//run/motord/bench.sock"; got {", ".join(endpoints) or "none"}. '
            'Other machines come in by "tls/0.0.0.0:7448" besides, with certificates and roles: '
            "`motord security init` makes them"
        )
    for number, endpoint in enumerate(endpoints):
        if endpoint in endpoints[:number]:
            raise ValueError(f"{endpoint} is listed twice")
        port = endpoint.rpartition(":")[2]
        if port.isdecimal() and not 0 < int(port) <= PORT_MAX:
            raise ValueError(f"{endpoint}: a port is a number from 1 to {PORT_MAX}")
    return endpoints


Endpoints = Annotated[tuple[str, ...], AfterValidator(_closed_to_others)]
"""Zenoh endpoints: TCP or Unix sockets of this machine alone, at least one, and TLS."""


class TlsConfig(Section):
    """`[zenoh.tls]`: who comes in from other machines; `motord security init` makes the files."""

    ca: Path
    """Certificate of the authority that signs all others."""
    certificate: Path
    """The daemon's certificate."""
    key: Path
    """The daemon's private key, readable by its user alone."""
    roles: Path
    """File that names each identity with its role."""


class ZenohConfig(Section):
    """`[zenoh]`: endpoints and telemetry rate. Beyond this machine only by TLS with `tls`."""

    listen: Endpoints = (DEFAULT_ENDPOINT,)
    """Endpoints: TCP ports and Unix sockets of this machine, and `tls/` for others."""
    tick_rate_Hz: Annotated[float, Field(gt=0, le=1000)] = 100.0
    """Rate of the single ticks on the key `tick`."""
    block_s: Annotated[float, Field(ge=0.01, le=1)] = 0.02
    """Time span of a block of ticks on the key `ticks`."""
    lease_s: Annotated[float, Field(ge=0.2, le=60)] = 2.0
    """Time after the last renewal of the lease by which no torque is left."""
    socket_group: Annotated[str, Field(min_length=1, max_length=32)] | None = None
    """Members of this group may connect to Unix sockets; left out: the daemon's own group."""
    tls: TlsConfig | None = None
    """Who comes in from other machines."""

    @property
    def local(self) -> tuple[str, ...]:
        """Endpoints of this machine alone."""
        return tuple(endpoint for endpoint in self.listen if not endpoint.startswith("tls/"))

    @property
    def remote(self) -> tuple[str, ...]:
        """Endpoints that other machines reach, with a certificate."""
        return tuple(endpoint for endpoint in self.listen if endpoint.startswith("tls/"))

    @model_validator(mode="after")
    def _a_group_needs_a_socket(self) -> "ZenohConfig":
        if self.socket_group and not any(e.startswith("unixsock-stream/") for e in self.listen):
            raise ValueError(
                f"socket_group = '{self.socket_group}' without an endpoint such as "
                '"unixsock-stream//run/motord/bench.sock" in listen'
            )
        return self

    @model_validator(mode="after")
    def _tls_is_all_or_nothing(self) -> "ZenohConfig":
        if self.remote and self.tls is None:
            raise ValueError(
                f"{', '.join(self.remote)} needs [zenoh.tls]: `motord security init` makes "
                "certificates and roles, and prints the section"
            )
        if self.tls is not None and not self.remote:
            raise ValueError('[zenoh.tls] without an endpoint such as "tls/0.0.0.0:7448" in listen')
        return self
