"""Recordings: MCAP files written and read in blocks of ticks, recovered, exported."""
