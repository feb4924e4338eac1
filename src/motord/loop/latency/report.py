"""The figures of a latency measurement, for people and files."""

from pydantic import BaseModel

from motord.loop.latency.measurement import Measured, median_of_slices_us
from motord.shm.histogram import TimeHistogram
from motord.shm.timing import Timing


class Figures(BaseModel, frozen=True):
    """Quantiles in us (None without samples), deadlines missed, number of samples."""

    p50_us: float | None = None
    p99_us: float | None = None
    p999_us: float | None = None
    max_us: float | None = None
    missed: int = 0
    samples: int = 0

    @classmethod
    def of(cls, histogram: TimeHistogram, missed: int) -> "Figures":
        """Return the figures of a histogram."""
        summary = histogram.summary()
        if summary.samples == 0:
            return cls(missed=missed)
        return cls(missed=missed, **summary.model_dump(exclude={"bins"}))


class Ratio(BaseModel, frozen=True):
    """The loop's lateness divided by that of cyclictest; None without samples of both."""

    p50: float | None = None
    p99: float | None = None


class Condition(BaseModel, frozen=True):
    """Figures over slices of one condition: clean, or stolen from."""

    loop: Figures
    work: Figures
    cyclictest: Figures | None = None


class LatencyReport(Condition):
    """Figures over clean slices; `stolen` has those over the rest.

    `ratio` divides quantiles over all clean slices, `ratio_of_medians` the medians over clean
    slices of each slice's quantiles, which single disturbances hardly move.
    """

    ratio: Ratio | None = None
    ratio_of_medians: Ratio | None = None
    slices: dict[str, int]
    stolen: Condition
    rate_Hz: float
    cpu: int
    priority: int
    spin: bool
    slice_s: float
    took_s: float
    realtime: list[str]


def report(measured: Measured) -> LatencyReport:
    """Return the figures of a measurement."""
    plan, clean, reference = measured.plan, _condition(measured, clean=True), measured.cyclictest
    counts = {
        "clean": sum(len(kind.clean) for kind in measured.kinds),
        "stolen": sum(len(kind.stolen) for kind in measured.kinds),
    }
    return LatencyReport(
        **clean.model_dump(),
        ratio=_ratio(clean),
        ratio_of_medians=ratio_of_medians(measured.loop.clean, reference.clean)
        if reference
        else None,
        slices=counts,
        stolen=_condition(measured, clean=False),
        rate_Hz=1e6 / plan.period_us,
        cpu=measured.cpu,
        priority=measured.ready.priority,
        spin=plan.loop.spin,
        slice_s=plan.slice_s,
        took_s=measured.took_s,
        realtime=measured.ready.realtime.lines(),
    )


def _condition(measured: Measured, *, clean: bool) -> Condition:
    loop = measured.loop.of(clean=clean)
    reference = measured.cyclictest.of(clean=clean) if measured.cyclictest is not None else None
    return Condition(
        loop=Figures.of(loop.wake_late, loop.missed),
        work=Figures.of(loop.work, 0),
        cyclictest=Figures.of(reference.wake_late, reference.missed) if reference else None,
    )


def _ratio(clean: Condition) -> Ratio | None:
    if clean.cyclictest is None:
        return None
    return Ratio(
        p50=_divide(clean.loop.p50_us, clean.cyclictest.p50_us),
        p99=_divide(clean.loop.p99_us, clean.cyclictest.p99_us),
    )


def ratio_of_medians(loop: list[Timing], reference: list[Timing]) -> Ratio:
    """Return the ratio of the medians over slices of each slice's quantiles, if both have any."""
    if not loop or not reference:
        return Ratio()
    late = [[part.wake_late for part in slices] for slices in (loop, reference)]
    p50, p99 = (
        median_of_slices_us(late[0], fraction) / median_of_slices_us(late[1], fraction)
        for fraction in (0.5, 0.99)
    )
    return Ratio(p50=p50, p99=p99)


def _divide(loop_us: float | None, reference_us: float | None) -> float | None:
    return loop_us / reference_us if loop_us is not None and reference_us else None
