"""The pictures: each module takes arrays and returns a figure."""
