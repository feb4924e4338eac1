"""RPC that puts the calibration in force as it is tracked; the tracker writes it to a file."""

import json
import shlex
from collections.abc import Collection
from dataclasses import dataclass

from motord.api import requests as rpc
from motord.api.errors import RpcError
from motord.api.replies import InstalledCalibration
from motord.api.requests import NOTHING_DEPARTED
from motord.experiments.tracking.tracked import NOT_IN_FORCE, TRACKING_OFF, TrackedCalibration
from motord.service.bench.calibrations import CalibrationStore
from motord.service.rpc.calibration import Installation, Prepared
from motord.service.rpc.dispatcher import RpcContext, Wait, handles
from motord.service.tracker.link import TrackerLink
from motord.shm.run_directory import RunDir

ADOPT_S = 10.0
"""For the tracker, whose priority is low."""


@dataclass(frozen=True)
class PreparedAdoption:
    """What the tracker wrote, and the id of the calibration that it was made from."""

    tracked: str
    prepared: Prepared


@dataclass
class Adoption:
    """Installs what was tracked of the calibration in force; `tracker`: None if that is off."""

    tracker: TrackerLink | None
    installation: Installation
    store: CalibrationStore
    run_dir: RunDir

    def prepare(self, payload: bytes) -> tuple[rpc.WithToken, PreparedAdoption]:
        """Have the tracker write the calibration, read it; for any thread. Raises RpcError."""
        request = rpc.parse(rpc.CALIBRATION_ADOPT, payload)
        tracked = self._written(request.accept)
        accept = self.store.accepted_findings()  # it keeps the findings of the one in force
        source = {"path": str(self.run_dir.adopted), "accept": accept}
        installing, prepared = self.installation.prepare(
            json.dumps({"token": request.token, **source}).encode()
        )
        return installing, PreparedAdoption(tracked, prepared)

    def save(self, prepared: PreparedAdoption, reply: InstalledCalibration) -> InstalledCalibration:
        """Write the calibration that is now in force to disk; for any thread. Raises RpcError."""
        accept = prepared.prepared.calibration.accept_options
        install = f"motord calibration install {shlex.quote(str(self.run_dir.adopted))} {accept}"
        return self.installation.save(prepared.prepared, reply, f"`{install.rstrip()}`")

    @handles(rpc.CALIBRATION_ADOPT)
    def adopt(self, request: rpc.WithToken, context: RpcContext) -> Wait[InstalledCalibration]:
        """Put it in force at zero torque, in place of that which it was made from."""
        adoption: PreparedAdoption = context.prepared
        how = f"adopted from tracking by {context.holder}"
        return self.installation.exchange(adoption.prepared, how, instead_of=adoption.tracked)

    def _written(self, accept: Collection[str]) -> str:
        """Have the tracker write `RunDir.adopted`; return the id of what it tracks."""
        if self.tracker is None:
            raise RpcError("refused", TRACKING_OFF)
        view = self.tracker.view
        if view is None:
            raise RpcError("refused", NOT_IN_FORCE)
        departed = any(one.adoptable for one in view.departed)
        if view.quantities and not departed and NOTHING_DEPARTED not in accept:
            raise RpcError("refused", _why_not(view))
        try:
            obstacle = self.tracker.adopt(ADOPT_S).obstacle
        except TimeoutError:
            raise RpcError("timeout", f"the tracker did not answer in {ADOPT_S:g} s") from None
        if obstacle:
            raise RpcError("refused", obstacle)
        return view.calibration


def _why_not(view: TrackedCalibration) -> str:
    """Return why nothing of what is tracked is adopted, and how to adopt it all the same."""
    if view.departed:
        names = ", ".join(one.name for one in view.departed)
        why = f"what has departed from calibration {view.calibration}, {names}, cannot be adopted"
        why += ": calibrate again; to adopt what else"
    else:
        why = f"calibration {view.calibration} holds: over {view.turns} turns no tracked quantity "
        why += "has left its interval; to adopt what"
    why += " is known better than it states, if anything is"
    return f"{why}: `motord calibration adopt --accept {NOTHING_DEPARTED}`"
