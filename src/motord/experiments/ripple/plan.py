"""The plan `verify`."""

from functools import partial

from motord.sequencing import mesh

make = partial(mesh.make, "verify")
