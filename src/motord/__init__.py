"""motord: real-time motor controller and data-acquisition daemon for a motor test bench."""

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
"""Where a daemon listens unless its bench file says otherwise; a Zenoh endpoint."""
