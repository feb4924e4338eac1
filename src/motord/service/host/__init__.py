"""The computer that the daemon runs on: log, service manager, scheduling, descriptors."""
