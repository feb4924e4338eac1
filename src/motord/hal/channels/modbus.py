"""Channels in registers of Modbus devices; those of one connection or serial line share it."""

import time
from collections.abc import Callable

from motord.config.channel_sources import ModbusSource
from motord.hal.base import DeviceError
from motord.hal.channel_source import RawSample
from motord.hal.modbus.client import ModbusClient
from motord.wire.modbus.pdu import read
from motord.wire.modbus.registers import Register


class ModbusChannel:
    """A register read by request.

    Frames on a serial line have no numbers: after a reading that failed it waits once more, so that
    a late response is not taken for one to the next request.
    """

    def __init__(
        self,
        source: ModbusSource,
        client: ModbusClient,
        wait: Callable[[float], None] = time.sleep,
    ) -> None:
        self._source = source
        self._client = client
        self._wait = wait
        self._failed = False
        self._register = Register(source.address, source.kind, 1.0, source.word_order)

    def open(self) -> None:
        """Leave it to the first reading to connect."""

    def read(self) -> RawSample:
        """Return the register. Raises DeviceError."""
        source = self._source
        what = f"read of {source.table} register {source.address}"
        request = read(source.table, source.address, self._register.words)
        try:
            words = self._client.exchange(what, request, source.unit)
        except DeviceError:
            self._failed = True
            if source.transport == "rtu":
                self._wait(source.timeout_s)
            raise
        return RawSample(self._register.decode(words))

    def close(self) -> None:
        """Disconnect, and with it all on the same line; the next reading connects again.

        After a reading that failed the client has done so itself, if the link was to blame.
        """
        failed, self._failed = self._failed, False
        if not failed:
            self._client.close()
