"""The gateway: the process that other computers reach by TLS, its audit and its link."""
