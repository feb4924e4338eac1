"""RPCs of the configuration and the calibration.

A calibration is read and checked in another process and turned into tables before the supervisor
gets the request, and written to disk after it; in between, only the tables are exchanged.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from motord.api import requests as rpc
from motord.api.errors import RpcError
from motord.api.replies import ConfigReply, InstalledCalibration
from motord.calibration import Calibration, CalibrationError
from motord.control import parameters
from motord.service.bench.bench import Bench
from motord.service.bench.calibrations import CalibrationStore, announce
from motord.service.bench.rest_currents import check_rest_currents
from motord.service.rpc.calibration_reader import Read, read_elsewhere
from motord.service.rpc.dispatcher import RpcContext, Wait, handles
from motord.service.rpc.preconditions import no_plan, zero_torque
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
