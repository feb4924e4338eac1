"""A Foxglove WebSocket server as a client of the daemon: shows everything, commands nothing."""
