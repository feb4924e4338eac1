"""Which kind of drive a rig has: the one that the bench file says it has."""

from motord.config import InverterConfig
from motord.rig.truth import RigTruth


def with_drive(truth: RigTruth, told: InverterConfig) -> RigTruth:
    """Return the rig with the bench's kind of drive.

    A drive that takes d and q has the axes that the rig file says, or else those that the bench
    file tells of.
    """
    dq = (truth.inverter.dq or told.dq) if told.driver == "can-dq" else None
    if dq == truth.inverter.dq:
        return truth
    inverter = truth.inverter.model_copy(update={"dq": dq})
    return truth.model_copy(update={"inverter": inverter})
