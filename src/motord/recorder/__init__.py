"""The recorder process: ticks out of the ring into recordings and black boxes."""
