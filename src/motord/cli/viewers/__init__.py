"""Commands that serve viewers: the page in the browser, Foxglove."""
