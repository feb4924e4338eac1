"""Alignment of phases and encoder: order and direction of the phases, zero of the encoder."""
