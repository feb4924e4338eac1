"""Progress of the queue in the terminal."""

from contextlib import suppress
from typing import TYPE_CHECKING

from motord.cli.bench.wording import duration, plan_progress
from motord.cli.console import progress_bar, remark
from motord.cli.plan.commands import PLAN_COLUMNS

if TYPE_CHECKING:
    from motord.api.messages import BenchState
    from motord.api.queue_messages import QueueView
    from motord.client import Client, Commander

LOOK_S = 1.0


def follow_queue(client: "Client", commander: "Commander", *, quiet: bool) -> "QueueView":
    """Show progress until the queue is paused; the first Ctrl-C aborts the plan under way."""
    from motord.client import ClientError

    with (
        progress_bar(*PLAN_COLUMNS, silent=quiet) as bar,
        client.subscribe_state() as states,
    ):
        task, ended = bar.add_task("", total=1.0), 0
        while True:
            try:
                state = states.get(LOOK_S) or client.state()
                queue = state.queue
                if queue is None or (not queue.active and queue.running is None):
                    return queue if queue is not None else client.queue().queue
                if queue.done > ended and not quiet:
                    remark(f"{queue.done} of {queue.done + queue.length} plans have ended")
                    ended = queue.done
                bar.update(task, completed=fraction(state), description=description(state))
                if not queue.active and state.plan is not None and state.plan.state == "paused":
                    return queue
            except KeyboardInterrupt:
                commander.pause_queue()
                with suppress(ClientError):  # it may have ended meanwhile
                    commander.abort_plan()


def fraction(state: "BenchState") -> float:
    """Return how much of the queue is done, each of its plans counting the same."""
    queue, plan = state.queue, state.plan
    if queue is None or not queue.done + queue.length:
        return 0.0
    part = plan.fraction if plan is not None and queue.running is not None and not plan.over else 0
    return (queue.done + part) / (queue.done + queue.length)


def description(state: "BenchState") -> str:
    """Return the time left, the place in the queue and what the plan under way does."""
    queue, plan = state.queue, state.plan
    assert queue is not None
    place = f"{queue.done + 1} of {queue.done + queue.length}"
    left = f"{duration(queue.eta_s)} left"
    if queue.running is None or plan is None or plan.over:
        return "; ".join(filter(None, (left, place, queue.next_plan, queue.message)))
    return "; ".join(filter(None, (left, place, plan.plan, plan_progress(plan), queue.message)))
