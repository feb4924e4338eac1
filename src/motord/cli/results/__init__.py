"""`motord results`, and the storing of what `motord analyse` finds."""
