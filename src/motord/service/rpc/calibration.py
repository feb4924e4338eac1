"""RPCs of the configuration and the calibration.

A calibration is read and checked in another process and turned into tables before the supervisor
gets the request, and written to disk after it; in between, only the tables are exchanged.
"""

import json
import shlex
from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np

from motord.api import requests as rpc
from motord.api.errors import RpcError
from motord.api.replies import ConfigReply, InstalledCalibration
from motord.api.requests import NOTHING_DEPARTED
from motord.calibration import Calibration, CalibrationError
from motord.control import parameters
from motord.experiments.tracking.tracked import NOT_IN_FORCE, TRACKING_OFF, TrackedCalibration
from motord.service.bench.bench import Bench
from motord.service.bench.calibrations import CalibrationStore, announce
from motord.service.bench.rest_currents import check_rest_currents
from motord.service.rpc.calibration_reader import Read, read_elsewhere
from motord.service.rpc.dispatcher import RpcContext, Wait, handles
from motord.service.rpc.preconditions import no_plan, zero_torque
from motord.service.tracker.link import TrackerLink
from motord.shm.run_directory import RunDir
from motord.shm.tables import TablesBusyError

EXCHANGE_S = 1.0

Tables = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
WriteTables = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], object]
"""Puts tables in force. Raises TablesBusyError until the loop has taken up those before."""


@dataclass(frozen=True)
class Prepared:
    """A calibration that fits the bench, and what the loop needs of it."""

    calibration: Calibration
    tables: Tables


class Installation:
    """Returns the configuration and installs calibrations; `toml`: the text of the bench file."""

    def __init__(
        self,
        bench: Bench,
        store: CalibrationStore,
        write_tables: WriteTables,
        toml: str,
        read: Read = read_elsewhere,
    ) -> None:
        self._bench = bench
        self._store = store
        self._write_tables = write_tables
        self._read = read
        self._config = ConfigReply(toml=toml, config=bench.config.model_dump(mode="json"))

    @handles(rpc.CONFIG)
    def config(self, request: rpc.NoArguments, context: RpcContext) -> ConfigReply:
        """Return the configuration as read (TOML text) and with its defaults (JSON)."""
        return self._config

    def prepare(self, payload: bytes) -> tuple[rpc.WithToken, Prepared]:
        """Read and check a calibration, build its tables; for any thread. Raises RpcError."""
        token, calibration = self._read(payload, self._bench.config.motor)
        try:
            check_rest_currents(calibration, self._bench.config)
        except CalibrationError as error:
            raise RpcError("invalid", str(error)) from None
        tables = parameters.build(self._bench.config, calibration)
        return rpc.WithToken(token=token), Prepared(calibration, tables)

    def save(
        self, prepared: Prepared, reply: InstalledCalibration, again: str = "install it again"
    ) -> InstalledCalibration:
        """Write the calibration that is now in force to disk; for any thread.

        Raises RpcError; `again` says what to do once the disk takes it.
        """
        try:
            path = self._store.save(prepared.calibration)
        except CalibrationError as error:
            raise RpcError(
                "failed",
                f"the calibration is in force, but not after a restart: {error}; "
                f"once that is mended, {again}",
            ) from None
        return reply.model_copy(update={"path": str(path)})

    @handles(rpc.CALIBRATION_INSTALL)
    def install(self, request: rpc.WithToken, context: RpcContext) -> Wait[InstalledCalibration]:
        """Put a prepared calibration in force at zero torque."""
        return self.exchange(context.prepared, f"installed by {context.holder}")

    def exchange(
        self, prepared: Prepared, how: str, instead_of: str | None = None
    ) -> Wait[InstalledCalibration]:
        """Put a calibration in force once the loop has taken up those before; `how`: for the event.

        That is refused during a plan, while torque is set, and if by then not the calibration
        `instead_of` is in force; None: whatever is.
        """

        def exchanged() -> InstalledCalibration | None:
            no_plan(self._bench)
            zero_torque(self._bench, "the torque would jump with the calibration")
            if instead_of not in (None, self._store.current_id()):
                raise RpcError("refused", "another calibration has been installed meanwhile")
            try:
                self._write_tables(*prepared.tables)
            except TablesBusyError:
                return None
            self._store.current = prepared.calibration
            self._bench.calibration_installed()
            announce(self._bench.events, prepared.calibration, how)
            return InstalledCalibration(
                id=prepared.calibration.id,
                created=prepared.calibration.created.isoformat(),
                age=prepared.calibration.age(),
                path="",
            )

        ramp_s = self._bench.config.longest_wind_down_s  # a torque may be on its way to zero
        return Wait(
            exchanged,
            EXCHANGE_S + ramp_s,
            lambda: "the loop did not take up the tables before these",
        )


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
