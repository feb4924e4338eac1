"""The supervisor's core on a virtual bench, served over Zenoh on loopback, in this process."""

import threading
from contextlib import contextmanager
from types import SimpleNamespace

from motord.api.messages import RecordingView
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
from motord.service.bench.calibrations import CalibrationStore
from motord.service.publish.publisher import Publisher
from motord.service.publish.telemetry import Telemetry
from motord.service.publish.zenoh_api import Api
from motord.service.rpc.calibration import Adoption, Installation
from motord.service.rpc.calibration_files import CalibrationFiles
from motord.service.rpc.calibration_reader import read, read_files
from motord.service.rpc.dispatcher import Dispatcher
from motord.service.rpc.intake import Offloaded
from motord.shm.run_directory import RunDir
from tests.support.ports import free_port
from tests.unit.service.virtual_service import STEP_NS, VirtualService


def endpoint():
    return f"tcp/127.0.0.1:{free_port()}"


class LiveService(VirtualService):
    """Steps in a thread, in real time, between requests that come over Zenoh."""

    def __init__(self, tmp_path, listen, tracker=None, **changes):
        super().__init__(**changes)
        self.listen = listen
        store = CalibrationStore(self.config, tmp_path)
        self.telemetry = Telemetry(self._put, self.config.loop.rate_Hz, 100.0, 0.1)
        self.publisher = Publisher(
            bench=self.bench,
            calibrations=store,
            children=SimpleNamespace(views=dict),
            recording=SimpleNamespace(
                path="", view=lambda: RecordingView(recording=False, path="")
            ),
            loop=SimpleNamespace(realtime=dict, bridge_clock=lambda: None),
            guard=SimpleNamespace(faults={}),
            telemetry=self.telemetry,
            tracker=tracker,
            started_ns=self.now_ns,
            unix_ns=lambda: self.now_ns,
        )
        self.events.listeners.append(self.publisher.event)
        installation = Installation(self.bench, store, lambda *tables: None, "the text", read)
        kept, self.store = CalibrationFiles(store, read_files), store
        adoption = Adoption(tracker, installation, store, RunDir("bench", tmp_path))
        self.dispatcher = Dispatcher(
            *(self.bench, self.operation, self.available, self.plans, self.queued),
            *(installation, kept, adoption),
        )
        longest = max_request_bytes(self.config.motor.counts)
        offloaded = {
            CALIBRATION_INSTALL.name: Offloaded(installation.prepare, installation.save, longest),
            CALIBRATION_ADOPT.name: Offloaded(adoption.prepare, adoption.save),
            CALIBRATION_LIST.name: Offloaded(kept.prepare_list),
            CALIBRATION_SHOW.name: Offloaded(kept.prepare_show),
            PLAN_LIST.name: Offloaded(
                self.available.prepare,
                self.available.encode,
                at_once=lambda: self.available.made,
            ),
            PLAN_START.name: Offloaded(self.plans.make),
            PLAN_RESUME.name: Offloaded(self.plans.read_remaining),
            QUEUE_ADD.name: Offloaded(self.queued.prepare_add),
        }
        self.api = Api(
            self.config.bench.name,
            self.dispatcher.calls,
            offloaded,
            self.publisher.documents,
            longest,
            lambda payload: self.bench.lease.is_in(payload, self.now_ns),
        )
        self.paused = threading.Event()
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._serve)

    def _put(self, name, payload):
        self.api.put(name, payload)

    def _serve(self):
        while not self._done.wait(STEP_NS / 1e9):
            if self.paused.is_set():
                continue
            self.dispatcher.take(self.now_ns)
            block = self.loop.run()
            self.now_ns += STEP_NS
            self.bench.step(block, 0, self.now_ns)
            self.queue.step(self.now_ns)
            self.dispatcher.step(self.now_ns)
            self.publisher.step(block, self.now_ns)

    def open(self):
        self.publisher.step(self.loop.run(), self.now_ns)  # the state is there when asked for
        self.api.open([self.listen])
        self.telemetry.start()
        self._thread.start()

    def close(self):
        self._done.set()
        self._thread.join()
        self.telemetry.stop()
        self.api.close()


@contextmanager
def live_service(tmp_path, name="live", listen=None, **changes):
    """Serve a virtual bench called `name` for as long as the block runs."""
    service = LiveService(tmp_path, listen or endpoint(), bench={"name": name}, **changes)
    service.open()
    try:
        yield service
    finally:
        service.close()
