"""The progress of a plan, from its start to its end, whoever else starts plans meanwhile."""

import weakref

import pytest

from motord.api.plan_messages import PlanView
from motord.client import ClientError, PlanEndedError, PlanRun
from motord.client.subscription import DocumentSubscription


def view(state="running", run_id="mine", t_ns=0, **more):
    return PlanView(plan="cogging", state=state, run_id=run_id, t_ns=t_ns, **more)


class Publisher:
    """Publishes `coming` to who subscribes, after the `present` progress; counts subscriptions."""

    def __init__(self, session, present, *coming):
        self.session, self.present, self.coming = session, present, coming
        self.asked = 0

    def subscribe_plan(self):
        subscription = DocumentSubscription(self.session, "plan", PlanView.model_validate_json)
        if self.present is not None:
            subscription.add_latest(self.present)
        for each in self.coming:
            self.session.sends(each.to_json())
        return subscription

    def plan(self):
        self.asked += 1
        return self.present


def test_progress_ends_with_the_plan(session):
    run = PlanRun(Publisher(session, view(), view(fraction=0.5), view("done")), "mine")
    assert [(each.state, each.fraction) for each in run] == [
        ("running", 0.0), ("running", 0.5), ("done", 0.0),
    ]  # fmt: skip
    assert not session.declared


def test_a_plan_that_was_over_before_anybody_looked_has_its_end(session):
    run = PlanRun(Publisher(session, view("done", points_done=3)), "mine")
    assert run.wait().points_done == 3
    assert [each.state for each in run] == ["done"]  # again


@pytest.mark.parametrize("state", ["aborted", "failed", "interrupted"])
def test_a_plan_that_was_not_done_ends_with_an_error(session, state):
    run = PlanRun(Publisher(session, view(), view(state, message="by anna")), "mine")
    seen = []
    with pytest.raises(PlanEndedError, match=f"cogging {state}: by anna") as caught:
        seen.extend(each.state for each in run)  # as far as it comes
    assert (caught.value.code, caught.value.progress.state) == (state, state)
    assert isinstance(caught.value, ClientError)


def test_who_stops_iterating_ends_the_subscription_and_can_go_on(session):
    run = PlanRun(Publisher(session, view(), view("done")), "mine")
    for each in run:
        assert each.state == "running"
        break
    assert not session.declared
    assert run.wait().state == "done"


def test_waiting_keeps_no_progress_but_the_last(session):
    steps = (view(fraction=n / 100) for n in range(100))
    publisher = Publisher(session, view(), *steps, view("done"))
    seen, alive = [], []

    class Watched(PlanRun):
        def __iter__(self):
            for progress in super().__iter__():
                seen.append(weakref.ref(progress))
                alive.append(sum(one() is not None for one in seen))
                yield progress

    assert Watched(publisher, "mine").wait().state == "done"
    assert len(alive) == 102
    assert max(alive) <= 3


@pytest.mark.parametrize("present", [None, view(run_id="another")])
def test_a_run_that_the_daemon_knows_no_more_is_said(session, present, monkeypatch):
    monkeypatch.setattr("motord.client.plan_run.SILENT_S", 0.0)
    with pytest.raises(ClientError, match="over") as caught:
        PlanRun(Publisher(session, present), "mine").wait()
    assert caught.value.code == "unknown"


def test_a_silent_plan_is_asked_for(session, monkeypatch):
    monkeypatch.setattr("motord.client.plan_run.SILENT_S", 0.01)
    publisher = Publisher(session, view())
    states = iter(PlanRun(publisher, "mine"))
    assert next(states).state == "running"
    publisher.present = view("done")
    assert next(states).state == "done"
    assert publisher.asked == 1


def test_a_daemon_that_is_gone_ends_it(session, monkeypatch):
    monkeypatch.setattr("motord.client.plan_run.SILENT_S", 0.01)

    class Gone(Publisher):
        def plan(self):
            raise ClientError("unreachable", "it is gone")

    with pytest.raises(ClientError, match="gone"):
        list(PlanRun(Gone(session, view()), "mine"))


def test_an_interruption_while_waiting_ends_the_subscription(session, monkeypatch):
    publisher = Publisher(session, view())

    def interrupt():
        raise KeyboardInterrupt

    publisher.plan = interrupt
    monkeypatch.setattr("motord.client.plan_run.SILENT_S", 0.01)
    with pytest.raises(KeyboardInterrupt):
        list(PlanRun(publisher, "mine"))
    assert not session.declared
