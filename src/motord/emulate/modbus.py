"""Emulated Modbus devices: pymodbus servers, TCP or RTU on a pseudo-terminal, in one thread."""

import asyncio
import logging
import socket
import threading
from collections.abc import Mapping
from pathlib import Path

from motord.process.hidden_packages import hidden

with hidden("aiohttp"):  # the web page of pymodbus' simulator would load it
    from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.constants import ExcCodes
from pymodbus.exceptions import NoSuchIdException
from pymodbus.server.base import ModbusBaseServer
from pymodbus.simulator import DataType, SimData, SimDevice
from pymodbus.transport import ModbusProtocol

from motord.config import ModbusLinkConfig
from motord.emulate import EmulatorError
from motord.emulate.devices import ReadOnlyRegisters, RegisterDevice
from motord.emulate.pty import Pty

# pymodbus logs every wrong request, to which the host gets an exception response
logging.getLogger("pymodbus").addHandler(logging.NullHandler())

READ_INPUT = 4
"""Function code "read input registers"; the others that are served concern holding ones."""
SERVED = (3, READ_INPUT, 6, 16, 22, 23)

FRAME_PAUSE_S = 0.005
"""Silence on a serial line after which what comes is the start of a new frame."""


Registers = RegisterDevice | ReadOnlyRegisters


class ModbusServers:
    """All Modbus devices of a bench: a server for each port, a unit for each device."""

    def __init__(self, devices: Mapping[str, tuple[ModbusLinkConfig, Registers]]) -> None:
        """Take the devices by name. Raises EmulatorError if two share port and unit."""
        self._places = _group(devices)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="modbus", daemon=True)
        self._ptys: list[Pty] = []
        self._servers: list[ModbusBaseServer] = []

    def start(self) -> None:
        """Listen on every port. Raises EmulatorError for one that cannot be had."""
        self._thread.start()
        try:
            asyncio.run_coroutine_threadsafe(self._listen(), self._loop).result()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End the servers and remove the pseudo-terminals; may be called twice."""
        if self._thread.is_alive():
            asyncio.run_coroutine_threadsafe(self._shut_down(), self._loop).result()
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join()
        self._loop.close()
        for pty in self._ptys:
            pty.close()

    async def _listen(self) -> None:
        for (place, port), units in self._places.items():
            devices = [_sim_device(*unit) for unit in units]
            if port:
                _refuse_taken(place, port)
                server: ModbusBaseServer = ModbusTcpServer(
                    [*devices, _absent_units()], address=(place, port)
                )
            else:
                self._ptys.append(Pty(Path(place)))
                server = _PtyServer([*devices, _absent_units()], self._ptys[-1])
            self._servers.append(server)
            try:
                await server.serve_forever(background=True)
            except RuntimeError as error:  # taken since the look at it
                raise EmulatorError(f"Modbus at {place}: {error}") from error

    async def _shut_down(self) -> None:
        for server in self._servers:
            await server.shutdown()  # type: ignore[no-untyped-call]
        others = asyncio.all_tasks() - {asyncio.current_task()}
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)


_Unit = tuple[ModbusLinkConfig, Registers]


def _group(devices: Mapping[str, _Unit]) -> dict[tuple[str, int], list[_Unit]]:
    """Sort devices by place: (host, TCP port) or (serial port, 0)."""
    places: dict[tuple[str, int], dict[int, tuple[str, _Unit]]] = {}
    for name, (config, device) in devices.items():
        place = (
            (config.host, config.tcp_port) if config.transport == "tcp" else (config.serial_port, 0)
        )
        units = places.setdefault(place, {})
        if config.unit in units:
            raise EmulatorError(
                f"[{name}.modbus] and [{units[config.unit][0]}.modbus] are both unit "
                f"{config.unit} of {place[0]}; give one of them another unit or port"
            )
        units[config.unit] = (name, (config, device))
    return {place: [unit for _, unit in units.values()] for place, units in places.items()}


def _sim_device(config: ModbusLinkConfig, device: Registers) -> SimDevice:
    """Return the pymodbus device whose registers are those of `device`."""

    async def access(
        function_code: int,
        start_address: int,
        address: int,
        _count: int,
        registers: list[int],
        values: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        if device.silent:
            raise asyncio.CancelledError  # ends the task of this request: it is never answered
        if function_code not in SERVED:
            return ExcCodes.ILLEGAL_FUNCTION
        if values is not None and not device.write(address, [int(v) for v in values]):
            return ExcCodes.ILLEGAL_VALUE
        table = "input" if function_code == READ_INPUT else "holding"
        for at, word in device.words(table).items():
            registers[at - start_address] = word
        return None

    unused = [SimData(0, values=[False] * 16, datatype=DataType.BITS)]
    holding, inputs = (
        [SimData(at, datatype=DataType.REGISTERS, readonly=at not in writable) for at in table]
        or [SimData(0, datatype=DataType.INVALID)]
        for table, writable in (
            (sorted(device.words("holding")), device.setpoint_addresses),
            (sorted(device.words("input")), range(0)),
        )
    )
    return SimDevice(config.unit, (unused, unused, holding, inputs), action=access)


def _absent_units() -> SimDevice:
    """Return the device that stands for every unit that does not exist."""

    async def access(*_request: object) -> None:
        raise NoSuchIdException("no such unit")

    everything = SimData(0, count=65_536, datatype=DataType.REGISTERS)
    return SimDevice(0, everything, action=access)


def _refuse_taken(host: str, port: int) -> None:
    """Raise EmulatorError if `port` cannot be listened on, saying why not."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
            probe.listen()
        except OSError as error:
            raise EmulatorError(
                f"Modbus port {host}:{port}: {error.strerror}; is another emulator running? "
                "If not, choose another tcp_port in the bench file"
            ) from error


class _PtyServer(ModbusSerialServer):
    """A Modbus RTU server on the device's end of a pseudo-terminal, which has no name to open."""

    def __init__(self, devices: list[SimDevice], pty: Pty) -> None:
        super().__init__(devices, port="pty", ignore_missing_devices=True)
        self._pty = pty
        self.call_create = self._create

    async def _create(self) -> tuple[asyncio.Transport, asyncio.BaseProtocol]:
        protocol = self.handle_new_connection()
        return _PtyTransport(self.loop, self._pty, protocol), protocol


class _PtyTransport(asyncio.Transport):
    """Carries bytes between a pseudo-terminal and a Modbus protocol."""

    def __init__(self, loop: asyncio.AbstractEventLoop, pty: Pty, protocol: ModbusProtocol) -> None:
        super().__init__()
        self._loop = loop
        self._pty = pty
        self._protocol = protocol
        self._received_s = 0.0
        loop.add_reader(pty.fileno(), self._read)
        loop.call_soon(protocol.connection_made, self)

    def _read(self) -> None:
        data = self._pty.read()
        if not data:
            return
        now_s = self._loop.time()
        if now_s - self._received_s > FRAME_PAUSE_S:
            self._protocol.recv_buffer = b""  # half a frame, or one that was not understood
        self._received_s = now_s
        self._protocol.data_received(data)

    def write(self, data: bytes | bytearray | memoryview) -> None:
        self._pty.write(bytes(data))

    def close(self) -> None:
        if self._pty.fileno() >= 0:
            self._loop.remove_reader(self._pty.fileno())
