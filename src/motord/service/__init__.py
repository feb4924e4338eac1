"""The daemon: supervisor, child processes, command lease, plan runner, Zenoh API, telemetry."""
