"""Commands that watch a bench and operate it manually."""
