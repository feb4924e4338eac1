"""A plan that sees its precision on the virtual bench, and ends by it."""

import pytest

from motord.sequencing.observation import Precision
from motord.service.estimator.link import ENDED
from tests.support import early_end
from tests.unit.service.virtual_service import VirtualService

X = early_end.QUANTITY


class PlayedEstimator:
    """In the place of the link: knows x to 1/n after n captures, `late` captures later."""

    def __init__(self, late=0):
        self.precision = None
        self.plans, self.points, self.ended = [], [], 0
        self._late = late

    def begin(self, plan):
        self.plans.append(plan)
        self.precision = None

    def captured(self, point):
        self.points.append(point)
        known = len(self.points) - self._late
        if known > 0:
            self.precision = Precision(known, {X: 1.0 / known})

    def end(self):
        self.ended += 1


@pytest.fixture
def service():
    return VirtualService()


def run(service, estimator, **settings):
    """Run the plan to its end; return its progress."""
    bench = service.bench
    bench.plans.estimator = estimator
    bench.plans.start(early_end.make(service.config, settings), "anna", "", detached=True)
    while bench.plans.active:
        service.step()
    return bench.plans.view


@pytest.mark.parametrize("late", [0, 3])
def test_a_plan_ends_as_soon_as_what_it_sees_reaches_its_targets(service, late):
    estimator = PlayedEstimator(late)
    view = run(service, estimator, points=40, x_percent=0.25)
    assert (view.state, view.points_done) == ("done", 4 + late + 1)  # seen with the next look
    assert (view.targets, view.precision, view.obstacle) == (
        {X: 0.25},
        {X: pytest.approx(1 / 5)},
        "",
    )
    assert [point["index"] for point in estimator.points] == list(range(view.points_done))
    assert [plan.name for plan in estimator.plans] == ["early-end"]
    assert estimator.ended == 1


def test_it_runs_to_its_end_when_nothing_is_known(service):
    view = run(service, None, points=6, x_percent=10.0)
    assert (view.state, view.points_done, view.precision) == ("done", 6, {})


def test_an_obstacle_is_shown_and_keeps_it_from_ending(service):
    class Lost(PlayedEstimator):
        def captured(self, point):
            super().captured(point)
            self.precision = Precision(1, {X: 0.0}, ENDED)

    view = run(service, Lost(), points=4, x_percent=0.5)
    assert (view.state, view.points_done) == ("done", 4)
    assert (view.precision, view.obstacle) == ({X: 0.0}, ENDED)


def test_a_plan_that_is_stopped_ends_its_estimator(service):
    estimator = PlayedEstimator()
    service.bench.plans.estimator = estimator
    plan = early_end.make(service.config, {})
    service.bench.plans.start(plan, "anna", "", detached=True)
    service.run_s(0.5)
    service.bench.stop("by a test")
    assert estimator.ended == 1
    points = len(estimator.points)
    service.run_s(0.5)
    assert len(estimator.points) == points
