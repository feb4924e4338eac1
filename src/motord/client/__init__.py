"""Python client of a running daemon, also used by the command line.

with motord.client.connect() as client:
    print(client.state().state)
    with client.lease("me") as lease:
        client.rpc("enable", token=lease.token)
        client.rpc("set", token=lease.token, torque_Nm=1.0, speed_Hz=0.5)
"""

from motord import DEFAULT_ENDPOINT
from motord.client.connection import Client, connect
from motord.client.error import ClientError
from motord.client.holder import operator
from motord.client.lease import Lease
from motord.client.subscription import Subscription

__all__ = [
    "DEFAULT_ENDPOINT",
    "Client",
    "ClientError",
    "Lease",
    "Subscription",
    "connect",
    "operator",
]
