"""The table of the daemon's child processes: add a process by adding a line."""

from motord.config import Config
from motord.loop.launch import loop_command
from motord.recorder.launch import recorder_command, spawn_recorder
from motord.service.bench.loop_link import LOOP
from motord.service.bench.recorder_session import RECORDER
from motord.service.gateway.link import GATEWAY, gateway_command, spawn_gateway
from motord.service.host.children import Process, spawn


def listens_to_others(config: Config) -> bool:
    """Return whether a bench can be reached from other machines."""
    return bool(config.zenoh.remote)


PROCESSES = (
    Process(
        GATEWAY, gateway_command, spawn_gateway,
        restart="always", while_=listens_to_others, stop_timeout_s=2.0,
        loss="until it is back nobody gets in from other machines",
    ),
    Process(
        RECORDER, recorder_command, spawn_recorder,
        restart="always", stop_timeout_s=10.0,
        loss="the next one goes on where its files end, as far as the ring reaches",
    ),
    Process(
        LOOP, loop_command, spawn,
        restart="on reset", stop_timeout_s=3.0,
        loss="inverter and bridge take the current away by their own timeouts",
    ),
)  # fmt: skip
