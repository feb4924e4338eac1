"""`motord analyse`: what recordings tell of the motor and of its torque. One module a kind."""

from motord.cli.analyse.align import align
from motord.cli.analyse.back_emf import back_emf
from motord.cli.analyse.calibrate import calibrate
from motord.cli.analyse.cogging import cogging
from motord.cli.analyse.inertia import inertia
from motord.cli.analyse.learn import learn
from motord.cli.analyse.sensitivity import sensitivity
from motord.cli.analyse.verify import verify
from motord.cli.console import group

app = group("Identify, verify, report.")
for command in (align, calibrate, learn, verify, cogging, back_emf, inertia, sensitivity):
    app.command()(command)
for plan in ("inertia-oscillation", "inertia-acceleration"):  # as every other: by the plan's name
    app.command(plan, hidden=True)(inertia)
