"""How long tests wait for what must come, all of them."""

PATIENCE_S = 120.0
"""For one event on a busy computer. No bound on the product: its times have their own tests."""
