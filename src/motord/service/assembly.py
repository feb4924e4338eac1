"""Puts the parts of the daemon together; nothing here starts or opens anything."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from motord.api.requests import CALIBRATION_INSTALL, PLAN_RESUME, max_request_bytes
from motord.calibration import Calibration, CalibrationError
from motord.config import Config
from motord.control import parameters
from motord.hal import registry
from motord.loop.launch import loop_command
from motord.recorder.launch import recorder_command, spawn_recorder
from motord.service.bench.bench import Bench
from motord.service.bench.blackbox import BlackBoxTrigger
from motord.service.bench.calibrations import CalibrationStore
from motord.service.bench.loop_link import LOOP, LoopLink
from motord.service.bench.recorder_session import RECORDER
from motord.service.bench.recording import RecordingControl
from motord.service.bench.slow_devices import DeviceThreads, SlowDevice
from motord.service.gateway.link import GateLink, gate_spec
from motord.service.host import scheduling
from motord.service.host.descriptors import DescriptorReserve
from motord.service.host.events import EventLog
from motord.service.plans.journal_file import Journal
from motord.service.plans.journal_sink import Durable
from motord.service.plans.resume import Resumption
from motord.service.processes import Children, ChildSpec, spawn
from motord.service.publish.publisher import Publisher
from motord.service.publish.state import StateView
from motord.service.publish.telemetry import Telemetry
from motord.service.publish.zenoh_api import Api
from motord.service.rpc.calibration import Installation
from motord.service.rpc.dispatcher import Dispatcher
from motord.service.rpc.intake import Offloaded
from motord.service.rpc.operation import ManualOperation
from motord.service.rpc.plans import PlanControl
from motord.service.supervisor import Supervisor
from motord.shm.mailbox import MailboxWriter
from motord.shm.run_directory import RunDir
from motord.shm.tables import TablesWriter
from motord.shm.unix_clock import Clock

LOOP_STOP_S = 3.0
RECORDER_STOP_S = 10.0


@dataclass(frozen=True)
class Assembly:
    """The parts of the daemon that are opened, started and stopped."""

    supervisor: Supervisor
    api: Api
    telemetry: Telemetry
    devices: Mapping[str, SlowDevice]
    device_threads: DeviceThreads


def process_table(config_path: Path, run_dir: RunDir) -> tuple[ChildSpec, ...]:
    """Return the daemon's child processes."""
    return (
        ChildSpec(
            name=LOOP,
            command=tuple(loop_command(config_path, run_dir)),
            restart="on reset",
            stop_timeout_s=LOOP_STOP_S,
            consequence="inverter and bridge take the current away by their own timeouts",
            spawn=spawn,
        ),
        ChildSpec(
            name=RECORDER,
            command=tuple(recorder_command(config_path, run_dir)),
            restart="always",
            stop_timeout_s=RECORDER_STOP_S,
            consequence="the next one goes on where its files end, as far as the ring reaches",
            spawn=spawn_recorder,
        ),
    )


def slow_devices(config: Config) -> dict[str, SlowDevice]:
    """Return the brake and the drive that are on a wire, not yet open. Raises DeviceError."""
    kinds: tuple[Literal["brake", "drive"], ...] = ("brake", "drive")
    devices: dict[str, SlowDevice] = {}
    for kind in kinds:
        section = config.brake if kind == "brake" else config.drive
        if section.driver not in ("sim", "none"):
            device = registry.make_setpoint_device(kind, config)
            # a brake takes speed out: it is left as it is until no torque can be left
            hold_s = config.wind_down_s(config.limits.torque_Nm) if kind == "brake" else 0.0
            devices[kind] = SlowDevice(
                *(kind, device, section.poll_s, section.stale_after_s),
                order_s=config.order_s,
                hold_s=hold_s,
            )
    return devices


def assemble(
    config: Config, toml: str, config_path: Path, run_dir: RunDir, state_dir: Path, clock: Clock
) -> Assembly:
    """Return the daemon of a bench, with its shared files made. Raises DeviceError."""
    events = EventLog(clock.now_ns)
    devices = slow_devices(config)
    if config.drive.driver not in ("sim", "none", "modbus"):
        events.emit(
            "device",
            f'[drive] driver = "{config.drive.driver}" is not motord\'s own: it is not known what '
            "stops the drive if nobody writes to it any more; see docs/modbus.md",
        )
    children = Children(
        (
            *process_table(config_path, run_dir),
            *((gate_spec(config_path),) if config.zenoh.remote else ()),
        ),
        DescriptorReserve(),
    )
    recording = RecordingControl(config, toml, children, events, clock.now_ns, run_dir.timing)
    journal = Journal(state_dir / "plans" / f"{config.bench.name}.jsonl")
    resumption = Resumption(config, journal, lambda: recording.calibration_id(), clock.now_ns)
    sink = Durable(recording, journal, resumption, events, clock.now_ns)
    mailbox = MailboxWriter(run_dir.setpoint, clock)
    tables = TablesWriter(run_dir.tables, config.motor.counts)
    bench = Bench(config, mailbox, devices, events, sink)
    boxes = BlackBoxTrigger(config, events, recording.about, clock.now_ns)
    recording.recorder.followers += [boxes, sink]
    bench.monitor.on_trip = boxes.trip
    store = CalibrationStore(config, state_dir)
    tables.write(*parameters.build(config, _installed(store, bench)))
    _take_up(journal, resumption, bench)

    def loop_is_gone(why: str) -> None:
        boxes.loop_died(why, bench.monitor)
        recording.loop_down()
        tables.forget_loop()
        bench.loop_down(why)
        recording.end(why)

    loop = LoopLink(children, run_dir, bench.loop_up, loop_is_gone)
    recording.calibration_id = lambda: store.current.id if store.current is not None else ""
    recording.realtime = loop.realtime
    recording.driven = lambda: bench.setpoint.drive_Hz != 0.0
    recording.on_plan_unrecorded = bench.plans.abort
    plans = PlanControl(bench, resumption, recording.obstacle)
    installation = Installation(bench, store, tables.write, toml)
    operation = ManualOperation(bench, lambda: loop.start(time.monotonic_ns()))
    dispatcher, zenoh = Dispatcher(bench, operation, plans, installation), config.zenoh
    telemetry = Telemetry(
        lambda name, payload: api.put(name, payload),
        config.loop.rate_Hz,
        zenoh.tick_rate_Hz,
        zenoh.block_s,
    )
    state = StateView(
        bench=bench,
        calibrations=store,
        processes=children.views,
        recording=recording.view,
        realtime=lambda: {**loop.realtime(), "supervisor": scheduling.current()},
        dropped=lambda: telemetry.dropped,
        started_ns=time.monotonic_ns(),
        unix_ns=clock.now_ns,
        bridge_clock=loop.bridge_clock,
        faults=lambda: dict(supervisor.guard.faults),
    )
    publisher = Publisher(bench, state, telemetry)
    events.listeners += [publisher.event, recording.recorder.event, boxes.event]
    longest = max_request_bytes(config.motor.counts)
    api = Api(
        config.bench.name,
        dispatcher.calls,
        offloaded={
            CALIBRATION_INSTALL.name: Offloaded(installation.prepare, installation.save, longest),
            PLAN_RESUME.name: Offloaded(plans.read_remaining),
        },
        documents={
            "state": publisher.state_document,
            "event": publisher.event_document,
            "plan": publisher.plan_document,
        },
        max_request_bytes=longest,
        in_command=lambda payload: bench.lease.is_in(payload, time.monotonic_ns()),
    )
    supervisor = Supervisor(
        *(bench, dispatcher, children, loop, recording, publisher),
        gate=GateLink(children, events) if config.zenoh.remote else None,
    )
    return Assembly(
        supervisor=supervisor,
        api=api,
        telemetry=telemetry,
        devices=devices,
        device_threads=DeviceThreads(list(devices.values())),
    )


def _take_up(journal: Journal, resumption: Resumption, bench: Bench) -> None:
    """Show the plan that was under way when the daemon ended, and say how it can go on."""
    journal.load()
    if journal.error:
        bench.events.emit("journal", f"cannot read it: {journal.error}")
    if words := resumption.words():
        bench.plans.show(resumption.view())
        bench.events.emit("plan", words)


def _installed(store: CalibrationStore, bench: Bench) -> Calibration | None:
    """Return the calibration that was installed before, if it fits; compensation is then on."""
    try:
        calibration = store.load_installed()
    except CalibrationError as error:
        bench.events.emit("calibration", f"the installed calibration is not used: {error}")
        return None
    if calibration is not None:
        bench.calibration_installed()
        bench.events.emit(
            "calibration", f"{calibration.id} is in force, {calibration.age()} old",
            id=calibration.id,
        )  # fmt: skip
    return calibration
