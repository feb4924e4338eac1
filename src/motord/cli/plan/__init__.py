"""Commands that run experiments on a running daemon."""
