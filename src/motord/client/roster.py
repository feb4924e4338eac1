"""Which benches there are, from what has come of each: tokens, answers, published states."""

from dataclasses import dataclass, field

from motord.api.messages import BenchState

SILENT_S = 1.0
"""A daemon publishes its state ten times a second; after so long without one it is silent."""
ANSWERED_S = 5.0
"""An answer counts for so long when the daemons of one name are counted."""


@dataclass(frozen=True)
class BenchEntry:
    """A bench as it is known. age_s: since a state was published, None before the first one.

    alive: its liveliness token is there; daemons: so many answer under its name, 0 as long as none
    has; problem: why what came of it could not be read; endpoint: one by which it is alive;
    counted: every daemon of its name has had its time to answer.
    """

    bench: str
    state: BenchState | None
    age_s: float | None
    alive: bool
    daemons: int
    problem: str = ""
    endpoint: str = ""
    counted: bool = False

    @property
    def silent(self) -> bool:
        """True if it publishes nothing: its daemon hangs, or the way to it is cut."""
        return self.age_s is None or self.age_s > SILENT_S

    @property
    def needed_for(self) -> str:
        """Why nothing else should keep the bench's computer busy now, "" if it is idle."""
        state = self.state
        if self.silent or state is None:
            return f"bench {self.bench} does not say what it does"
        if state.plan is not None and not state.plan.over:
            return f"bench {self.bench} runs the plan {state.plan.plan}"
        if state.state == "ENABLED":
            return f"bench {self.bench} is enabled"
        return f"bench {self.bench} records" if state.recording.recording else ""


@dataclass
class _Seen:
    tokens: set[str] = field(default_factory=set)  # endpoints by which it is alive
    answers: dict[str, float] = field(default_factory=dict)  # Zenoh id to when it answered, s
    state: BenchState | None = None
    published_s: float | None = None
    problem: str = ""
    counted: bool = False


class BenchRoster:
    """Benches by name. Times `now_s` are monotonic seconds."""

    def __init__(self) -> None:
        self._seen: dict[str, _Seen] = {}

    def token(self, bench: str, endpoint: str, *, there: bool) -> None:
        """Note that a liveliness token has come or gone at an endpoint."""
        seen = self._seen.setdefault(bench, _Seen())
        (seen.tokens.add if there else seen.tokens.discard)(endpoint)
        if not seen.tokens:
            seen.answers.clear()
            seen.published_s = None

    def answered(self, bench: str, replier: str, state: BenchState, now_s: float) -> None:
        """Note an answer of the Zenoh session `replier`; what was published is newer."""
        seen = self._seen.setdefault(bench, _Seen())
        seen.answers[replier] = now_s
        if seen.published_s is None:
            seen.state = state

    def all_answered(self, bench: str) -> None:
        """Note that a query to all daemons of a name, or of any with "*", has ended."""
        for name, seen in self._seen.items():
            if bench in (name, "*") and seen.answers:
                seen.counted = True

    def published(self, bench: str, state: BenchState, now_s: float) -> None:
        """Note a state as it was published."""
        seen = self._seen.setdefault(bench, _Seen())
        seen.state, seen.published_s, seen.problem = state, now_s, ""

    def malformed(self, bench: str, problem: str) -> None:
        """Note that something came that is no state."""
        self._seen.setdefault(bench, _Seen()).problem = problem

    def names(self) -> list[str]:
        """Return all names, also of benches that are gone."""
        return sorted(self._seen)

    def entries(self, now_s: float) -> list[BenchEntry]:
        """Return the benches that are there, by name: alive, publishing, or just answering."""
        return [entry for bench in self.names() if (entry := self._entry(bench, now_s)) is not None]

    def _entry(self, bench: str, now_s: float) -> BenchEntry | None:
        seen = self._seen[bench]
        age_s = None if seen.published_s is None else max(0.0, now_s - seen.published_s)
        daemons = sum(now_s - at_s <= ANSWERED_S for at_s in seen.answers.values())
        alive, problem = bool(seen.tokens), seen.problem
        if not alive and not daemons and (age_s is None or age_s > SILENT_S):
            return None
        endpoint = min(seen.tokens, default="")
        return BenchEntry(
            bench, seen.state, age_s, alive, daemons, problem, endpoint, counted=seen.counted
        )
