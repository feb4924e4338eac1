"""The plan `back-emf`."""

from functools import partial

from motord.sequencing import driven_rotor

make = partial(driven_rotor.make, "back-emf")
