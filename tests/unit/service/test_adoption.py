"""`calibration/adopt`: the calibration as it is tracked is installed, or why it is not."""

import json
from contextlib import nullcontext

import pytest

from motord.api.errors import RpcError
from motord.calibration import Calibration
from motord.calibration.file import load
from motord.experiments.tracking.tracked import TrackedCalibration, TrackedQuantity
from motord.service.bench.calibrations import CalibrationStore
from motord.service.rpc.calibration import Adoption, Installation
from motord.service.rpc.calibration_reader import read
from motord.service.rpc.dispatcher import Call, Dispatcher
from motord.service.tracker.protocol import AdoptedReport
from motord.shm.run_directory import RunDir
from tests.support.calibrations import calibration, put_in_force
from tests.support.panic import PanicError
from tests.unit.service.test_installation import Tables, finding
from tests.unit.service.virtual_service import VirtualService


def tracked(in_force, departed=True, adoptable=True, **changes):
    alpha = TrackedQuantity(
        name="alpha_a", meaning="the gain of phase a", unit="1", value=0.82, half_width=0.001,
        in_force=0.8, in_force_half_width=0.002, departed=departed, adoptable=adoptable,
    )  # fmt: skip
    about = {"calibration": in_force.id, "turns": 70, "quantities": (alpha,), **changes}
    return TrackedCalibration(**about)


class FakeTracker:
    """Writes `adopts` when it is asked to."""

    def __init__(self, run_dir):
        self.run_dir, self.view, self.adopts, self.obstacle, self.late = run_dir, None, None, "", 0
        self.asked = 0

    def adopt(self, timeout_s):
        self.asked += 1
        if self.late:
            raise TimeoutError
        if not self.obstacle:
            self.adopts.save(self.run_dir.adopted)
        return AdoptedReport(number=1, obstacle=self.obstacle)


class AdoptingService(VirtualService):
    """A virtual bench whose calibration is tracked."""

    def __init__(self, tmp_path):
        super().__init__()
        run_dir = RunDir("bench", tmp_path)
        run_dir.create()
        self.store, self.tables = CalibrationStore(self.config, tmp_path / "state"), Tables()
        self.tracker = FakeTracker(run_dir)
        installation = Installation(self.bench, self.store, self.tables.write, "", read)
        self.installation = installation
        self.adoption = Adoption(self.tracker, installation, self.store, run_dir)
        self.off = Adoption(None, installation, self.store, run_dir)
        self.dispatcher = Dispatcher(self.bench, self.operation, installation, self.adoption)
        self.in_force = calibration()
        put_in_force(self.store, self.in_force)
        self.tracker.view = tracked(self.in_force)
        self.tracker.adopts = calibration(alpha=(0.82, 1.1, 1.1086))

    def adopt(self, token, *accept, between=lambda: None):
        """Return the reply to a request to adopt, as the intake's thread makes it."""
        payload = json.dumps({"token": token, "accept": accept}).encode()
        request, prepared = self.adoption.prepare(payload)
        between()
        call = Call("calibration/adopt", request, prepared)
        self.dispatcher.handle(call, self.now_ns)
        self.step(20)
        return self.adoption.save(prepared, call.wait(0)).content()

    def refusal(self, token, *accept, **more):
        """Return why a request was refused, with which nothing has changed."""
        with pytest.raises(RpcError) as caught:
            self.adopt(token, *accept, **more)
        assert self.tables.written == []
        return caught.value


@pytest.fixture
def service(tmp_path):
    return AdoptingService(tmp_path)


def test_the_tracked_calibration_is_in_force_and_kept(service):
    reply = service.adopt(service.acquire())
    adopted = service.tracker.adopts
    assert reply["id"] == adopted.id == service.store.current_id()
    assert reply["path"] == str(service.store.file())
    assert service.tables.written[0][0]["alpha"][0] == pytest.approx(adopted.alpha)
    assert service.store.load_installed() == adopted
    said = [one.message for one in service.events.recent() if one.kind == "calibration"]
    assert said == [f"{adopted.id} adopted from tracking by anna"]


def test_what_could_not_be_kept_can_be_installed_from_the_tracker_s_file(service, tmp_path):
    service.store.directory = tmp_path / "state" / "in the way"
    service.store.directory.write_text("as a full disk")
    with pytest.raises(RpcError, match="not after a restart") as caught:
        service.adopt(service.acquire())
    assert service.store.current_id() == service.tracker.adopts.id
    file = service.tracker.run_dir.adopted
    assert caught.value.message.endswith(
        f"once that is mended, `motord calibration install {file}`"
    )
    assert load(file) == service.tracker.adopts


def test_the_findings_it_has_are_accepted_by_the_command_that_is_named(service, tmp_path):
    """Those of the one in force were no obstacle to adopting it; to installing it they are."""
    found = (finding("torque-left"),)
    in_force = calibration(findings=found)
    put_in_force(service.store, in_force)
    service.tracker.view = tracked(in_force)
    service.tracker.adopts = calibration(alpha=(0.82, 1.1, 1.1086), findings=found)
    service.store.directory = tmp_path / "state" / "in the way"
    service.store.directory.write_text("as a full disk")
    with pytest.raises(RpcError, match="not after a restart") as caught:
        service.adopt(service.acquire())
    file = service.tracker.run_dir.adopted
    assert caught.value.message.endswith(
        f"`motord calibration install {file} --accept torque-left`"
    )


def test_it_is_adopted_at_zero_torque_alone(service):
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=1.0, speed_Hz=0.5)
    service.run_s(2.0, token)
    assert "set torque_Nm = 0 first" in service.refusal(token).message
    service.ask("set", token=token, torque_Nm=0.0)
    service.run_s(1.0, token)
    assert service.adopt(token)["id"] == service.tracker.adopts.id


def test_it_takes_the_lease(service):
    refusal = service.refusal("no such token")
    assert refusal.code == "no_lease"


def test_what_holds_is_not_replaced_unless_that_is_accepted(service):
    service.tracker.view = tracked(service.in_force, departed=False)
    token = service.acquire()
    refusal = service.refusal(token)
    assert refusal.code == "refused"
    assert "over 70 turns no tracked quantity has left its interval" in refusal.message
    assert "known better than it states, if anything is: `motord calibration" in refusal.message
    assert "`motord calibration adopt --accept nothing-departed`" in refusal.message
    assert service.tracker.asked == 0
    assert service.adopt(token, "nothing-departed")["id"] == service.tracker.adopts.id


@pytest.mark.parametrize(
    ("change", "code", "said"),
    [
        (lambda s: setattr(s, "adoption", s.off), "refused", "set enabled = true in [tracking]"),
        (lambda s: setattr(s.tracker, "view", None), "refused", "no calibration is in force"),
        (lambda s: setattr(s.tracker, "obstacle", "3 turns are too few"), "refused",
         "3 turns are too few"),
        (lambda s: setattr(s.tracker, "late", True), "timeout", "did not answer in 10 s"),
    ],
)  # fmt: skip
def test_why_there_is_nothing_to_adopt(service, change, code, said):
    change(service)
    refusal = service.refusal(service.acquire())
    assert refusal.code == code
    assert said in refusal.message


def test_a_calibration_that_was_installed_meanwhile_stays(service):
    other = calibration(beta_A=(0.0, 0.0, 0.0))
    refusal = service.refusal(service.acquire(), between=lambda: put_in_force(service.store, other))
    assert refusal.message == "another calibration has been installed meanwhile"
    assert service.store.current_id() == other.id


def test_a_calibration_that_is_installed_in_the_same_step_stays(service):
    other = calibration(beta_A=(0.0, 0.0, 0.0))

    def install():
        content = {"token": service.token, "calibration": other.to_json()}
        request, prepared = service.installation.prepare(json.dumps(content).encode())
        call = Call("calibration/install", request, prepared)
        service.dispatcher.handle(call, service.now_ns)

    service.token = service.acquire()
    with pytest.raises(RpcError, match="another calibration has been installed meanwhile"):
        service.adopt(service.token, between=install)
    assert (service.store.current_id(), len(service.tables.written)) == (other.id, 1)


@pytest.mark.parametrize("accept", ["torque-left", "nothing", ""])
def test_nothing_else_is_accepted_by_name(service, accept):
    assert service.refusal(service.acquire(), accept).code == "invalid"


def test_what_departed_and_cannot_be_adopted_is_no_reason_to_adopt(service):
    service.tracker.view = tracked(service.in_force, adoptable=False)
    token = service.acquire()
    said = service.refusal(token).message
    assert said.startswith(f"what has departed from calibration {service.in_force.id}, alpha_a, ")
    assert "cannot be adopted: calibrate again" in said
    assert service.adopt(token, "nothing-departed")["id"] == service.tracker.adopts.id


def test_serious_findings_that_were_accepted_before_are_no_obstacle(service):
    found = tuple(finding(f"found-{number}") for number in range(32))
    service.tracker.adopts = calibration(alpha=(0.82, 1.1, 1.1086), findings=found)
    token = service.acquire()
    assert "found-31" in service.refusal(token).message
    in_force = calibration(findings=found)
    put_in_force(service.store, in_force)
    service.tracker.view = tracked(in_force)
    assert service.adopt(token)["id"] == service.tracker.adopts.id


def test_one_of_another_motor_is_no_calibration_of_this_bench(service):
    other = calibration().motor.model_copy(update={"serial": "other"})
    service.tracker.adopts = calibration(motor=other)
    assert service.refusal(service.acquire()).code == "invalid"


def killed(*_arguments):
    raise PanicError("kill -9")


@pytest.mark.parametrize("at", ["tables", "file", "mark", "reply"])
def test_a_daemon_that_is_killed_on_the_way_has_one_of_both_in_force_at_its_next_start(
    service, monkeypatch, at
):
    """Never half of the other; and what was not kept can be adopted once more."""
    service.store.save(service.in_force)
    token = service.acquire()
    steps = {
        "tables": (service.installation, "_write_tables"),
        "file": (Calibration, "save"),
        "mark": (service.store, "_mark"),
    }

    def between():
        if at in steps:
            monkeypatch.setattr(*steps[at], killed)

    with pytest.raises(PanicError) if at in steps else nullcontext():
        service.adopt(token, between=between)
    monkeypatch.undo()
    store = CalibrationStore(service.config, service.store.directory.parents[1])
    in_force = service.in_force if at in steps else service.tracker.adopts
    assert store.load_installed() == in_force
    assert store.file() == store.directory / f"{in_force.id}.json"
    store.current = load(service.tracker.run_dir.adopted)
    store.save(store.current)
    assert store.load_installed() == service.tracker.adopts
