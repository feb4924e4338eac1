"""Waking up on time: sleep to a margin before the deadline, then watch the clock.

A sleeping thread wakes up late by what timer, scheduler and an idle core take, mostly microseconds,
at times many more. The margin follows a high quantile of that lateness, so that all but the rarest
are over before the deadline. Watching the clock costs power, and real-time priority shuts others
out meanwhile: the margin also keeps the loop's share of the core below what the kernel allows to
real-time threads, above which it would stop them for what is left of its period.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

MARGIN_MIN_ns, MARGIN_START_ns, MARGIN_MAX_ns = 6_000, 60_000, 150_000
_RISE, _FALL = 4, 11
"""Steps of the followed quantile: 1/16 of itself up, 1/2048 down, in balance at 99.2 %."""
_SHARE_OF_LIMIT = 0.9
_MAX_PERIODS = 8
"""What one tick can add to the account: a stall of the machine is not the loop's doing."""


@dataclass(frozen=True)
class Bandwidth:
    """The share of a core that the kernel allows to real-time threads, over `period_ns`."""

    share: float = 0.95
    period_ns: int = 1_000_000_000

    @classmethod
    def of_this_kernel(cls, folder: Path = Path("/proc/sys/kernel")) -> "Bandwidth":
        """Return what the kernel is set to; its default if that is not known.

        A kernel without a limit, or that allows no time at all, stops no thread.
        """
        try:
            runtime_us = int((folder / "sched_rt_runtime_us").read_text())
            period_us = int((folder / "sched_rt_period_us").read_text())
        except (OSError, ValueError):
            return cls()
        if runtime_us <= 0 or period_us <= 0:
            return cls(1.0)
        return cls(min(runtime_us / period_us, 1.0), period_us * 1000)


class Margin:
    """How long before the deadline to wake up: 1.25 times the 99.2 % quantile of the lateness.

    The quantile is followed, not computed: a lateness above it raises it by a sixteenth, any other
    lowers it by a two-thousandth. The margin stays within MARGIN_MIN_ns and MARGIN_MAX_ns; a
    lateness beyond that is a stall that no margin covers, and teaches nothing.
    """

    def __init__(self) -> None:
        self._quantile_ps = MARGIN_START_ns * 800
        self.margin_ns = MARGIN_START_ns

    def learn(self, late_ns: int) -> None:
        """Take into account that the last sleep ended `late_ns` after its time."""
        if late_ns > MARGIN_MAX_ns:
            return
        quantile_ps = self._quantile_ps
        if late_ns * 1000 > quantile_ps:
            quantile_ps = min(quantile_ps + (quantile_ps >> _RISE), MARGIN_MAX_ns * 800)
        else:
            quantile_ps = max(quantile_ps - (quantile_ps >> _FALL), MARGIN_MIN_ns * 800)
        self._quantile_ps = quantile_ps
        self.margin_ns = quantile_ps // 800


class DutyCycle:
    """The account of a loop of `period_ns`: time that passes is earned at a share, work spends it.

    The share is 0.9 of what the kernel allows. `spin_ns` is what a tick can spend on watching the
    clock, after its work. `budget_exceeded`, the debt is over half the distance between share and
    limit: the loop has to give time back by skipping ticks, or the kernel will stop it.
    """

    def __init__(self, period_ns: int, bandwidth: Bandwidth) -> None:
        share = _SHARE_OF_LIMIT * bandwidth.share
        self._idle_per_1024 = round((1.0 - share) * 1024)
        self._allowed_ns = int(share * period_ns)
        self._longest_ns = _MAX_PERIODS * period_ns
        self._debt_max_ns = int((bandwidth.share - share) * bandwidth.period_ns / 2)
        self._work_ns = self._debt_ns = 0
        self.spin_ns = self._allowed_ns
        self.budget_exceeded = False

    def account(self, busy_ns: int, work_ns: int, idle_ns: int) -> None:
        """Enter a tick: `work_ns` of its `busy_ns` were work; then the loop slept `idle_ns`."""
        longest_ns = self._longest_ns
        if busy_ns > longest_ns:
            busy_ns = longest_ns
        if work_ns > longest_ns:
            work_ns = longest_ns
        debt_ns = self._debt_ns + ((busy_ns + idle_ns) * self._idle_per_1024 >> 10) - idle_ns
        self._debt_ns = debt_ns = debt_ns if debt_ns > 0 else 0
        self.budget_exceeded = debt_ns > self._debt_max_ns
        self._work_ns += (work_ns - self._work_ns) >> 6
        spin_ns = self._allowed_ns - self._work_ns
        self.spin_ns = spin_ns if spin_ns > 0 else 0


class HybridSleep:
    """Waits for deadlines of a loop of `period_ns`; all times are monotonic ns.

    Without `spin` it sleeps up to the deadline itself. `clock_ns` returns the time and `sleep_s`
    passes it.
    """

    def __init__(
        self,
        period_ns: int,
        *,
        spin: bool = True,
        bandwidth: Bandwidth | None = None,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        sleep_s: Callable[[float], None] = time.sleep,
    ) -> None:
        self.clock_ns = clock_ns
        self._sleep_s = sleep_s
        self._spin = spin
        self._margin = Margin()
        self._duty = DutyCycle(period_ns, bandwidth or Bandwidth.of_this_kernel())
        self.start()

    @property
    def margin_ns(self) -> int:
        """How long before the deadline the next sleep will end."""
        return min(self._margin.margin_ns, self._duty.spin_ns) if self._spin else 0

    @property
    def budget_exceeded(self) -> bool:
        """True if the loop has used so much of the core that it has to skip a tick."""
        return self._duty.budget_exceeded

    def start(self) -> None:
        """Say that the loop starts now; what was before counts as idle."""
        self._left_ns = self._slept_ns = self.clock_ns()

    def wait_until(self, deadline_ns: int) -> int:
        """Return at `deadline_ns`, or at once if it is over; returns the time of returning."""
        clock_ns = self.clock_ns
        now_ns = called_ns = clock_ns()
        margin_ns = self.margin_ns
        wake_ns = deadline_ns - margin_ns
        while now_ns < wake_ns:
            self._sleep_s((wake_ns - now_ns) * 1e-9)
            now_ns = clock_ns()
        if now_ns > called_ns and margin_ns:
            self._margin.learn(now_ns - wake_ns)
        self._duty.account(
            called_ns - self._slept_ns, called_ns - self._left_ns, now_ns - called_ns
        )
        self._slept_ns = now_ns
        now_ns = clock_ns()
        while now_ns < deadline_ns:
            now_ns = clock_ns()
        self._left_ns = now_ns
        return now_ns
