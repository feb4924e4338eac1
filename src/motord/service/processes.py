"""The table of the daemon's child processes: add a process by adding a line."""

from motord.recorder.launch import spawn_piped
from motord.service.channels.link import CHANNELS
from motord.service.estimator.link import ESTIMATOR
from motord.service.gateway.link import GATEWAY
from motord.service.host.children import Process, spawn
from motord.service.host.loop_link import LOOP
from motord.service.recording.session import RECORDER
from motord.service.tracker.link import TRACKER

PROCESSES = (
    Process(
        GATEWAY, "motord.service.gateway.process", spawn_piped,
        restart="always", while_=lambda config: bool(config.zenoh.remote), stop_timeout_s=2.0,
        backoff_last_s=10.0,
        loss="until it is back nobody gets in from other machines",
    ),
    Process(
        RECORDER, "motord.recorder.main", spawn_piped,
        restart="always", stop_timeout_s=10.0,
        loss="the next one goes on where its files end, as far as the ring reaches",
    ),
    Process(
        CHANNELS, "motord.service.channels.process", spawn_piped,
        restart="always", backoff_last_s=5.0,
        while_=lambda config: bool(config.channels),
        loss="until it is back no channel is read: one with a trip limit trips after timeout_s",
    ),
    Process(
        ESTIMATOR, "motord.service.estimator.process", spawn_piped,
        restart="never",
        loss="the plan under way goes on and does not end early",
    ),
    Process(
        TRACKER, "motord.service.tracker.process", spawn_piped,
        restart="while wanted", backoff_last_s=60.0,
        while_=lambda config: config.tracking.enabled,
        loss="tracking of the calibration begins anew",
    ),
    Process(
        LOOP, "motord.loop.main", spawn,
        restart="on reset", stop_timeout_s=3.0,
        loss="inverter and bridge take the current away by their own timeouts",
    ),
)  # fmt: skip
