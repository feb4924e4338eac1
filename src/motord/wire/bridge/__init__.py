"""Frames between host and bridge board, their framing, numbering and checksums."""
