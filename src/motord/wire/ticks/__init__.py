"""Blocks of ticks as protobuf messages."""
