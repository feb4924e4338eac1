"""A page in a browser: its socket, its lease, what it may ask and how often."""
