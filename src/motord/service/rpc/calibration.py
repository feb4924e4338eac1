"""RPCs that concern what the daemon was set up with: its configuration and the calibration.

A calibration is read and checked in another process and turned into tables before the supervisor
sees the request, and written to disk after it; only the exchange of the tables happens in between.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from motord.api.errors import RpcError
from motord.api.requests import WithToken
from motord.calibration import Calibration, CalibrationError
from motord.config import Config
from motord.control import parameters
from motord.service.bench.bench import Bench
from motord.service.bench.calibrations import CalibrationStore
from motord.service.rpc.calibration_reader import Read, read_elsewhere
from motord.service.rpc.calls import Answer, Call
from motord.service.rpc.dispatcher import Handler, Wait, expect, need_no_plan, need_zero_torque
from motord.shm.tables import TablesBusyError

SWAP_S = 1.0

Tables = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
WriteTables = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], object]
"""Puts tables in force. Raises TablesBusyError while the loop has not taken up those before."""


@dataclass(frozen=True)
class Prepared:
    """A calibration that fits the bench, and what the loop needs of it."""

    calibration: Calibration
    tables: Tables


class Installation:
    """Answers `config` and installs calibrations; `toml` is the text of the bench file."""

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
        self._config_answer = config_answer(bench.config, toml)
        self.handlers: dict[str, Handler] = {
            "config": lambda call, now_ns: self._config_answer,
            "calibration/install": self._install,
        }

    def prepare(self, payload: bytes) -> tuple[WithToken, Prepared]:
        """Read and check a calibration, make its tables; for any thread. Raises RpcError."""
        token, calibration = self._read(payload, self._bench.config.motor)
        tables = parameters.build(self._bench.config, calibration)
        return WithToken(token=token), Prepared(calibration, tables)

    def keep(self, prepared: Prepared, answer: Answer) -> Answer:
        """Write the calibration that is now in force to disk; for any thread. Raises RpcError."""
        try:
            path = self._store.keep(prepared.calibration)
        except CalibrationError as error:
            raise RpcError(
                "failed", f"the calibration is in force, but not after a restart: {error}"
            ) from None
        return {**answer, "path": str(path)}

    def _install(self, call: Call, now_ns: int) -> Answer | Wait:
        bench, prepared = self._bench, call.prepared
        who = bench.lease.require(expect(WithToken, call).token, now_ns).holder
        need_no_plan(bench)
        need_zero_torque(bench, "the torque would jump with the calibration")

        def swapped() -> Answer | None:
            try:
                self._write_tables(*prepared.tables)
            except TablesBusyError:
                return None
            self._store.current = prepared.calibration
            bench.calibration_installed()
            bench.events.emit(
                "calibration", f"{prepared.calibration.id} installed by {who}",
                id=prepared.calibration.id,
            )  # fmt: skip
            return {
                "id": prepared.calibration.id,
                "created": prepared.calibration.created.isoformat(),
                "age": prepared.calibration.age(),
            }

        return Wait(swapped, SWAP_S, lambda: "the loop did not take up the tables before these")


def config_answer(config: Config, toml: str) -> dict[str, Any]:
    """Return the configuration as read (TOML text) and with its defaults (JSON)."""
    return {"toml": toml, "config": config.model_dump(mode="json")}
