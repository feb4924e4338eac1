"""Python client of a running daemon, also used by the command line; for asyncio: `client.aio`.

>>> from motord.client import connect
>>> with connect() as client:
...     print(client.state().state)
...     with client.lease() as lease:
...         print(lease.set(enable=True, torque_Nm=0.5, speed_Hz=0.5).state)
OFF
ENABLED

Further examples of this package go on with a `client` that is connected.
"""

from motord import DEFAULT_ENDPOINT
from motord.client.client import Client
from motord.client.commander import Commander
from motord.client.discovery import connect
from motord.client.error import ClientError, PlanEndedError
from motord.client.holder import operator
from motord.client.lease import Lease
from motord.client.plan_run import PlanRun
from motord.client.subscription import (
    DocumentSubscription,
    Subscription,
    TickLosses,
    TickSubscription,
)

__all__ = [
    "DEFAULT_ENDPOINT",
    "Client",
    "ClientError",
    "Commander",
    "DocumentSubscription",
    "Lease",
    "PlanEndedError",
    "PlanRun",
    "Subscription",
    "TickLosses",
    "TickSubscription",
    "connect",
    "operator",
]
