"""Commands that set a bench up: its file, its service."""
