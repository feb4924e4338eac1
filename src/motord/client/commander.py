"""What the holder of the lease may ask of a bench."""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from motord.api import queue_requests
from motord.api import requests as rpc
from motord.api.queue_messages import QueuedPlan
from motord.api.queue_requests import QueueContent
from motord.api.replies import (
    InstalledCalibration,
    PlanName,
    PlanOutline,
    PlanProgress,
    SetpointReply,
    StateReply,
)
from motord.api.requests import ReplyT, Rpc
from motord.client.plan_run import PlanPublisher, PlanRun
from motord.schema import Compensation

if TYPE_CHECKING:
    from motord.calibration import Calibration


class RpcTarget(PlanPublisher, Protocol):
    """What of a client a commander needs."""

    def call(self, rpc: Rpc[Any, ReplyT], /, **arguments: Any) -> ReplyT:
        """Call an RPC and return its reply. Raises ClientError."""


class Commander:
    """The requests that need the lease, made with its `token`.

    Each returns the daemon's reply and raises ClientError with the daemon's code and message if it
    is refused: "no_lease" if the token is not, or no longer, that of the lease in force.
    """

    def __init__(self, daemon: RpcTarget, token: str = "") -> None:
        self.token = token
        self._daemon = daemon

    def enable(self) -> StateReply:
        """Enable at zero torque; returns once the bench is ENABLED."""
        return self._daemon.call(rpc.ENABLE, token=self.token)

    def disable(self) -> StateReply:
        """Ramp the torque to zero, then disable; ends a plan."""
        return self._daemon.call(rpc.DISABLE, token=self.token)

    def reset(self) -> StateReply:
        """Leave a trip whose cause is gone; start the loop anew if it has ended or hangs."""
        return self._daemon.call(rpc.RESET, token=self.token)

    def set(
        self,
        *,
        torque_Nm: float | None = None,
        speed_Hz: float | None = None,
        brake: float | None = None,
        drive_Hz: float | None = None,
        compensate: Compensation | None = None,
        enable: bool = False,
    ) -> SetpointReply:
        """Change what is given of the set-point; all of it is checked before any of it is done.

        speed_Hz: turns per second, which the brake is servoed to. brake: its excitation itself, 0
        to 1. drive_Hz: speed of the external drive. enable: enable the bench first. Returns before
        the torque is reached, which `reached_in_s` of the reply says.
        """
        given = {
            "torque_Nm": torque_Nm,
            "speed_Hz": speed_Hz,
            "brake": brake,
            "drive_Hz": drive_Hz,
            "compensate": compensate,
        }
        asked = {name: value for name, value in given.items() if value is not None}
        return self._daemon.call(rpc.SET, token=self.token, enable=enable, **asked)

    def start_plan(
        self,
        name: str,
        settings: Mapping[str, Any] | None = None,
        *,
        detach: bool = False,
        notes: str = "",
        serial: str = "",
        check: bool = True,
    ) -> PlanOutline:
        """Start a plan and return at once what it will do.

        settings: those that differ from the bench's own. detach: the plan goes on when the lease
        ends. notes: for the recording. serial: the motor's, for the recording, where the bench file
        names none. check: the calibration is checked before, if the bench file asks for it.
        """
        return self._daemon.call(
            rpc.PLAN_START,
            token=self.token,
            name=name,
            settings=dict(settings or {}),
            detach=detach,
            notes=notes,
            **({"serial": serial} if serial else {}),  # which older daemons do not know
            **({} if check else {"check": False}),
        )

    def run_plan(
        self,
        name: str,
        settings: Mapping[str, Any] | None = None,
        *,
        detach: bool = False,
        notes: str = "",
        serial: str = "",
        check: bool = True,
    ) -> PlanRun:
        """Start a plan as `start_plan` does, and return what to follow it by."""
        outline = self.start_plan(
            name, settings, detach=detach, notes=notes, serial=serial, check=check
        )
        return PlanRun(self._daemon, outline.run_id)

    def pause_plan(self) -> PlanProgress:
        """Ramp to zero and wait; the point under way is taken again after `resume_plan`."""
        return self._daemon.call(rpc.PLAN_PAUSE, token=self.token)

    def resume_plan(self, *, detach: bool = False) -> PlanProgress:
        """Go on after a pause, or take what is missing of a plan that ended before it was done.

        detach: as of `start_plan`, for the latter.
        """
        return self._daemon.call(rpc.PLAN_RESUME, token=self.token, detach=detach)

    def abort_plan(self) -> PlanProgress:
        """Ramp down, disable, end the plan; returns before it has ended."""
        return self._daemon.call(rpc.PLAN_ABORT, token=self.token)

    def discard_plan(self) -> PlanName:
        """Forget a plan that was interrupted; its recordings stay."""
        return self._daemon.call(rpc.PLAN_DISCARD, token=self.token)

    def add_to_queue(self, plans: Sequence[QueuedPlan]) -> QueueContent:
        """Put plans at the end of the queue, all or none; `added` has their numbers.

        >>> from motord.api.queue_messages import QueuedPlan
        >>> with client.lease("anna") as lease:
        ...     added = lease.add_to_queue([QueuedPlan(name="cogging", settings={"turns": 2})])
        ...     lease.remove_from_queue(added.added).queue.length
        0
        """
        given = [plan.model_dump(mode="json") for plan in plans]
        return self._daemon.call(queue_requests.QUEUE_ADD, token=self.token, plans=given)

    def move_in_queue(self, id: int, position: int) -> QueueContent:
        """Give an item of the queue another place: 1 is the next one to run."""
        return self._daemon.call(
            queue_requests.QUEUE_MOVE, token=self.token, id=id, position=position
        )

    def remove_from_queue(self, ids: Sequence[int]) -> QueueContent:
        """Take items out of the queue; the one under way stays."""
        return self._daemon.call(queue_requests.QUEUE_REMOVE, token=self.token, ids=[*ids])

    def start_queue(self, *, detach: bool = False) -> QueueContent:
        """Run the plans of the queue one after the other, or go on after a pause.

        detach: it goes on when the lease ends.
        """
        return self._daemon.call(queue_requests.QUEUE_START, token=self.token, detach=detach)

    def pause_queue(self, *, now: bool = False) -> QueueContent:
        """Begin no further plan; the one under way runs to its end, or pauses `now`, too."""
        return self._daemon.call(queue_requests.QUEUE_PAUSE, token=self.token, now=now)

    def install_calibration(
        self, calibration: "Calibration | Path", *, accept: Collection[str] = ()
    ) -> InstalledCalibration:
        """Put a calibration in force, now and after a restart; the torque must be zero.

        A path is one on the daemon's machine. accept: names of the calibration's serious findings;
        with one that is not named it is refused.
        """
        source: dict[str, Any] = (
            {"path": str(calibration)}
            if isinstance(calibration, Path)
            else {"calibration": calibration.to_json()}
        )
        if accept:  # daemons of before do not know the field
            source["accept"] = list(accept)
        return self._daemon.call(rpc.CALIBRATION_INSTALL, token=self.token, **source)

    def adopt_calibration(self, *, accept: Collection[str] = ()) -> InstalledCalibration:
        """Put the calibration in force as it is tracked; the torque must be zero.

        Refused if no quantity has departed that can be adopted, unless accept has
        "nothing-departed".
        """
        return self._daemon.call(rpc.CALIBRATION_ADOPT, token=self.token, accept=list(accept))
