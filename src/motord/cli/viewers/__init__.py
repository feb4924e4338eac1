"""Commands that serve viewers: the page in the browser, Foxglove."""

NICE = 5
"""Of programs that show a bench: daemon and recorder go first."""
