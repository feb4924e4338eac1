"""The plan `cogging`."""

from functools import partial

from motord.sequencing import driven_rotor

make = partial(driven_rotor.make, "cogging")
