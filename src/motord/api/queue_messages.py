"""The queue of plans: what is added to it, its items and their runs, and its state in short."""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from motord.api.published_message import PublishedMessage
from motord.section import Finite, Positive, Section, matching
from motord.verdict.serial import check_serial

ChannelName = Annotated[str, Field(min_length=1, max_length=64)]
TimeOfDay = Annotated[
    str, matching(r"([01]\d|2[0-3]):[0-5]\d", "a time of day as HH:MM, from 00:00 to 23:59")
]
PLANS_MAX = 64
"""Plans that are added by one request."""


class QueueWait(Section):
    """`[[plan.wait]]`: what has to come about before a plan of the queue begins."""

    channel: ChannelName | None = None
    """Waits for the value of this channel to be `below` or `above` a limit."""
    below: Finite | None = None
    """Upper limit, in the unit of the channel."""
    above: Finite | None = None
    """Lower limit, in the unit of the channel."""
    until: TimeOfDay | None = None
    """Waits until this time of day, `HH:MM` on the daemon's computer, next comes."""
    limit_s: Positive | None = None
    """Waits no longer than that; then the plan has failed. Without it there is no limit."""

    @model_validator(mode="after")
    def _one_condition(self) -> "QueueWait":
        bounds = [bound for bound in (self.below, self.above) if bound is not None]
        if self.until is not None and (self.channel is not None or bounds):
            raise ValueError("until stands alone: a channel is another wait")
        if self.until is None and (self.channel is None or len(bounds) != 1):
            raise ValueError("give until, or a channel with either below or above")
        return self

    def to_text(self) -> str:
        """Return the condition, as in `winding below 40`."""
        if self.until is not None:
            return f"until {self.until}"
        bound = f"below {self.below:g}" if self.below is not None else f"above {self.above:g}"
        return f"{self.channel} {bound}"


class QueuedPlan(Section):
    """`[[plan]]`: a plan to be run by the queue."""

    name: Annotated[str, Field(min_length=1, max_length=64)]
    """The plan, as `motord plan list` names it."""
    settings: dict[str, Any] = Field(default_factory=dict)
    """Its settings, where they differ from the bench file's."""
    notes: Annotated[str, Field(max_length=4000)] = ""
    """For the recording."""
    serial: Annotated[str, AfterValidator(check_serial)] | None = None
    """The motor's serial number, for the recording; refused if the bench file names another."""
    check: bool = True
    """Check the calibration before, if `[calibration] check_before_plans` asks for it."""
    wait: Annotated[tuple[QueueWait, ...], Field(max_length=8)] = ()
    """What it waits for first, one after the other."""
    on_failure: Literal["stop", "skip", "retry"] = "stop"
    """What the queue does if the plan fails: pause, leave it and go on, or run it again."""
    retries: Annotated[int, Field(ge=1, le=100)] = 1
    """With `retry`: how often at most; then the queue is paused."""


class QueuedPlans(Section):
    """The file for `motord queue add --file`."""

    plan: Annotated[tuple[QueuedPlan, ...], Field(min_length=1, max_length=PLANS_MAX)]
    """The plans, in order."""


class QueueItem(PublishedMessage):
    """A plan in the queue."""

    id: int
    """Its number, never given again."""
    plan: QueuedPlan
    """What is to be run."""
    estimate_s: float
    """How long it takes, about, without its waits."""
    added_by: str = ""
    """Holder of the lease that added it."""
    state: Literal["queued", "running", "failed", "aborted", "interrupted"] = "queued"
    """`running` from its preparation on; the last three: how it ended before, and it is to run
    again."""
    failures: int = 0
    """How often it has failed since the queue was started."""
    run_id: str = ""
    """Of the progress of its run; "" before the first."""
    turn_ns: int = 0
    """Unix time when its turn came, from which `until` counts; 0 before."""


class QueueRun(PublishedMessage):
    """How a run of an item ended."""

    id: int
    """Number of the item."""
    plan: str
    """Name of the plan."""
    state: Literal["done", "failed", "aborted", "interrupted"]
    """How it ended; `interrupted`: the daemon ended meanwhile."""
    message: str = ""
    """Why it ended so."""
    kept: bool = False
    """The item stayed in the queue then, to be run again."""
    run_id: str = ""
    """Of its progress; "" if the plan did not begin."""
    recording: str = ""
    """Path of its recording."""
    began_ns: int = 0
    """Unix time; 0 if it is not known or the plan did not begin."""
    ended_ns: int = 0
    """Unix time."""


class QueueView(PublishedMessage):
    """The queue of plans in short; `queue/list` has its items."""

    state: Literal["paused", "waiting", "running", "pausing"] = "paused"
    """`waiting` for the conditions of the next plan; `pausing` when the one under way ends."""
    message: str = ""
    """Why it is paused, or what it waits for."""
    length: int = 0
    """Items in it, the one under way among them."""
    running: int | None = None
    """Number of the item under way."""
    next: int | None = None
    """Number of the item after it."""
    next_plan: str = ""
    """Name of its plan."""
    done: int = 0
    """Items that have left it since it was started, done or skipped."""
    failed: int = 0
    """Runs that have failed since it was started."""
    eta_s: float = 0.0
    """Until it is empty, about; waits for channels are not in it."""
    detached: bool = False
    """It goes on without a lease."""

    @property
    def active(self) -> bool:
        """True while it begins plans by itself."""
        return self.state != "paused"
