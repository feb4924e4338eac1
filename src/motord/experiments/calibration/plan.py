"""The plan `calibrate`."""

from functools import partial

from motord.sequencing import mesh

make = partial(mesh.make, "calibrate")
