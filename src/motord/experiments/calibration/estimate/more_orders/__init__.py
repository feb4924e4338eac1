"""Cogging orders that slots and poles do not allow: the search for them, and what comes of it."""
