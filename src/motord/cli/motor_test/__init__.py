"""`motord test`: a motor, or a shift of them, against the limits of their type."""
