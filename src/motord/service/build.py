"""Builds the daemon of a bench, each part after those that it needs; opens and starts nothing."""

import time
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Literal

from motord.api.queue_requests import QUEUE_ADD
from motord.api.requests import (
    CALIBRATION_ADOPT,
    CALIBRATION_INSTALL,
    CALIBRATION_LIST,
    CALIBRATION_SHOW,
    PLAN_LIST,
    PLAN_RESUME,
    PLAN_START,
    max_request_bytes,
)
from motord.calibration import Calibration, CalibrationError
from motord.config import Config
from motord.control import parameters
from motord.hal import registry
from motord.hal.channels.registry import check_drivers
from motord.process.ending_threads import Worker
from motord.service.bench.bench import Bench
from motord.service.bench.blackbox import BlackBoxTrigger
from motord.service.bench.calibrations import CalibrationStore, announce
from motord.service.bench.guard import Guard
from motord.service.bench.slow_devices import DeviceThreads, SlowDevice
from motord.service.channels.link import ChannelLink
from motord.service.estimator.link import EstimatorLink
from motord.service.gateway.link import GatewayLink
from motord.service.host.children import Children
from motord.service.host.descriptors import DescriptorReserve
from motord.service.host.events import EventLog
from motord.service.host.loop_link import LoopLink
from motord.service.host.systemd import Notifier
from motord.service.plans.journal_file import Journal
from motord.service.plans.resume import Resumption
from motord.service.processes import PROCESSES
from motord.service.publish.publisher import Publisher, named_state
from motord.service.publish.telemetry import Telemetry
from motord.service.publish.zenoh_api import Api
from motord.service.queue.attempt import ChannelValue
from motord.service.queue.queue_file import QueueFile
from motord.service.queue.runner import QueueRunner
from motord.service.recording.control import RecordingControl
from motord.service.rpc.calibration import Adoption, Installation
from motord.service.rpc.calibration_files import CalibrationFiles
from motord.service.rpc.dispatcher import Dispatcher
from motord.service.rpc.intake import Offloaded
from motord.service.rpc.operation import ManualOperation
from motord.service.rpc.plan_list import AvailablePlans
from motord.service.rpc.plans import PlanControl
from motord.service.rpc.queue import QueuedPlanControl, QueueOperation
from motord.service.supervisor import Supervisor
from motord.service.tracker.link import TrackerLink
from motord.shm.mailbox import MailboxWriter
from motord.shm.run_directory import RunDir
from motord.shm.tables import TablesWriter
from motord.unix_clock import Clock

TICK_TEMPERATURES = ("temperature_C", "brake_temperature_C")
"""Fields of the tick that the queue can wait for as for a slow channel."""


@dataclass(frozen=True)
class Daemon:
    """What `motord run` opens, starts and stops."""

    supervisor: Supervisor
    api: Api
    telemetry: Telemetry
    device_threads: DeviceThreads


def build(
    config: Config,
    toml: str,
    config_path: Path,
    run_dir: RunDir,
    state_dir: Path,
    clock: Clock,
    notifier: Notifier,
) -> Daemon:
    """Return the daemon of a bench, with its shared files made. Raises DeviceError."""
    events = EventLog(clock.now_ns)
    children = Children(
        [process for process in PROCESSES if process.while_(config)],
        lambda process: process.start(config_path, run_dir),
        DescriptorReserve(),
    )
    loop = LoopLink(children, run_dir)
    store = CalibrationStore(config, state_dir)
    tables = TablesWriter(run_dir.tables, config.motor.counts)

    recording = RecordingControl(
        *(config, toml, children, events, clock.now_ns, run_dir.timing),
        about=lambda: {**store.metadata(), "realtime": loop.realtime()},
        driven=lambda: bench.setpoint.drive_Hz != 0.0,
        state=lambda now_ns: named_state(bench, now_ns),
        on_plan_unrecorded=lambda why: bench.plans.unrecorded(why),
    )
    boxes = BlackBoxTrigger(config, events, recording.about, clock.now_ns)
    journal = Journal(state_dir / "plans" / f"{config.bench.name}.jsonl")
    resumption = Resumption(config, recording, journal, store.current_id, events, clock.now_ns)
    recording.recorder.on_process += [boxes.recorder, resumption.recorder]
    recording.recorder.on_report = boxes.report
    mailbox = MailboxWriter(run_dir.setpoint, clock)
    bench = Bench(config, mailbox, slow_devices(config, events), events, resumption)
    bench.monitor.on_trip = boxes.trip
    check_drivers(config.channels)
    channels = (
        ChannelLink(bench.channels, children, events, recording.channel)
        if config.channels
        else None
    )
    bench.plans.estimator = estimator = EstimatorLink(children, events)
    tracker = TrackerLink(store, children, events) if config.tracking.enabled else None

    tables.write(*parameters.build(config, installed_calibration(store, bench)))
    show_interrupted_plan(journal, resumption, bench)

    guard = Guard(bench)
    telemetry = Telemetry(
        lambda name, payload: api.put(name, payload),
        *(config.loop.rate_Hz, config.zenoh.tick_rate_Hz, config.zenoh.block_s),
    )
    publisher = Publisher(
        *(bench, store, children, recording, loop, guard, telemetry, tracker),
        *(time.monotonic_ns(), clock.now_ns),
    )
    events.listeners += [publisher.event, recording.recorder.event, boxes.event]

    installation = Installation(bench, store, tables.write, toml)
    adoption = Adoption(tracker, installation, store, run_dir)
    plans = PlanControl(bench, resumption, recording.obstacle, store.file)
    queue = QueueRunner(
        *(bench, QueuedPlanControl(bench, plans, resumption)),
        QueueFile(state_dir / "plans" / f"{config.bench.name}.queue.json"),
        channel_value(bench),
        time.time_ns,
        Worker("queue").submit,
    )
    queue.load()
    dispatcher, offloaded = build_rpc(
        bench, plans, resumption, queue, recording, loop, store, installation, adoption
    )
    api = Api(
        *(config.bench.name, dispatcher.calls, offloaded, publisher.documents),
        max_request_bytes(config.motor.counts),
        in_command=lambda payload: bench.lease.is_in(payload, time.monotonic_ns()),
    )
    supervisor = Supervisor(
        *(bench, queue, dispatcher, children, loop, tables, recording, boxes),
        *(publisher, channels, estimator, tracker),
        GatewayLink(children, events) if config.zenoh.remote else None,
        *(guard, notifier),
    )
    return Daemon(supervisor, api, telemetry, DeviceThreads(list(bench.devices.values())))


def build_rpc(
    bench: Bench,
    plans: PlanControl,
    resumption: Resumption,
    queue: QueueRunner,
    recording: RecordingControl,
    loop: LoopLink,
    store: CalibrationStore,
    installation: Installation,
    adoption: Adoption,
) -> tuple[Dispatcher, dict[str, Offloaded]]:
    """Return what carries requests out, and which of them are prepared in other threads."""
    queued = QueueOperation(bench, plans, resumption, queue)
    operation = ManualOperation(
        bench, lambda: loop.start(time.monotonic_ns()), loop.kill, recording.file
    )
    kept, available = CalibrationFiles(store), AvailablePlans(bench)
    longest = max_request_bytes(bench.config.motor.counts)
    services = operation, available, plans, queued, installation, adoption, kept
    return Dispatcher(bench, *services), {
        CALIBRATION_ADOPT.name: Offloaded(adoption.prepare, adoption.save),
        CALIBRATION_INSTALL.name: Offloaded(installation.prepare, installation.save, longest),
        CALIBRATION_LIST.name: Offloaded(kept.prepare_list),
        CALIBRATION_SHOW.name: Offloaded(kept.prepare_show),
        PLAN_LIST.name: Offloaded(
            available.prepare, available.encode, at_once=lambda: available.made
        ),
        PLAN_START.name: Offloaded(plans.make),
        PLAN_RESUME.name: Offloaded(plans.read_remaining),
        QUEUE_ADD.name: Offloaded(queued.prepare_add),
    }


def channel_value(bench: Bench) -> ChannelValue:
    """Return what gives the queue values: of slow channels, or temperatures of the newest tick."""

    def value_of(name: str) -> float | None:
        if name not in TICK_TEMPERATURES:
            return bench.channels.value_to_wait_for(name, time.monotonic_ns())
        tick = bench.monitor.last  # a view of it takes as long as the rest of a step
        return float(tick[name]) if tick is not None and isfinite(tick[name]) else None

    return value_of


def slow_devices(config: Config, events: EventLog) -> dict[str, SlowDevice]:
    """Return the brake and the drive that are on a wire, not yet open. Raises DeviceError."""
    kinds: tuple[Literal["brake", "drive"], ...] = ("brake", "drive")
    devices: dict[str, SlowDevice] = {}
    for kind in kinds:
        section = config.brake if kind == "brake" else config.drive
        if section.driver not in ("sim", "none"):
            device = registry.make_setpoint_device(kind, config)
            # a brake takes speed out: it is left as it is until no torque can be left
            hold_s = config.longest_wind_down_s if kind == "brake" else 0.0
            devices[kind] = SlowDevice(
                *(kind, device, section.poll_s, section.stale_after_s),
                setpoint_valid_s=config.setpoint_valid_s,
                hold_s=hold_s,
                watchdog=kind == "drive" or bool(section.modbus and section.modbus.watchdog_s),
            )
    if config.drive.driver not in ("sim", "none", "modbus"):
        events.emit(
            "device",
            f'[drive] driver = "{config.drive.driver}" is not motord\'s own: it is not known what '
            "stops the drive if nobody writes to it any more; see docs/modbus.md",
        )
    return devices


def installed_calibration(store: CalibrationStore, bench: Bench) -> Calibration | None:
    """Return the calibration that was installed before, if it fits; compensation is then on."""
    try:
        calibration = store.load_installed()
    except CalibrationError as error:
        bench.events.emit("calibration", f"the installed calibration is not used: {error}")
        return None
    if calibration is not None:
        bench.calibration_installed()
        comma = "," if calibration.serious_names else ""
        announce(bench.events, calibration, f"is in force, {calibration.age()} old{comma}")
    return calibration


def show_interrupted_plan(journal: Journal, resumption: Resumption, bench: Bench) -> None:
    """Show the plan that was under way when the daemon ended, and say how it can go on."""
    journal.load()
    if journal.error:
        bench.events.emit("journal", f"cannot read it: {journal.error}")
    if summary := resumption.summary():
        bench.plans.show(resumption.view(), resumption.mesh())
        bench.events.emit("plan", summary)
