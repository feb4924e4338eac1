"""What the keys do. Commands run in threads, so the screen goes on being drawn.

What is shown as the state is always what the daemon published, never what was asked of it: a stop
is "stopping..." until then.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

from motord.api.replies import PlanProgress, StateReply
from motord.cli.bench.operate import set_text
from motord.cli.bench.watch.dialogs import (
    NOTE_LENGTH,
    NUMBER_LENGTH,
    STOP_LETTERS,
    Confirmation,
    Dialog,
    Entry,
    Help,
)
from motord.cli.bench.watch.feed import EVENTS_KEPT, Feed
from motord.cli.bench.watch.operator_session import (
    OperatorSession,
    PendingStop,
    in_thread,
    refusal_text,
)
from motord.client import ClientError, Commander
from motord.security.access import permits

if TYPE_CHECKING:
    from motord.api.messages import BenchState


class Controls:
    """Dialog, message and commands under way. `leave` ends the screen."""

    def __init__(self, feed: Feed, session: OperatorSession, leave: Callable[[], object]) -> None:
        self._feed, self._session, self._leave = feed, session, leave
        self._identity = session.client.identity
        self.dialog: Dialog | None = None
        self.message, self.alarming = "", False
        self.events_back = 0
        self._command = ""  # that the daemon has not answered
        self._stopping = PendingStop()
        self._actions: dict[str, Callable[[], object]] = {
            "stop": self.stop,
            "pause": self.pause_or_resume,
            "abort": self.abort,
            "note": self.note,
            "reset": lambda: self._change_state("reset", Commander.reset),
            "lease": self.take_or_give,
            "enable": lambda: self._change_state("enable", Commander.enable, keep=True),
            "disable": lambda: self._change_state("disable", Commander.disable),
            "torque": self.torque,
            "older": lambda: self.scroll(1),
            "newer": lambda: self.scroll(-1),
            "newest": lambda: self.scroll(-EVENTS_KEPT),
            "quit": self.quit,
            "help": self.help,
        }

    def do(self, action: str) -> None:
        """Do what `keys.KEYS` calls `action`."""
        self._actions[action]()

    def press(self, key: str, character: str | None) -> None:
        """Take a key for the dialog; Escape stops the bench in any of them."""
        dialog = self.dialog
        if dialog is None:
            return
        if key == "escape" or key in dialog.stops:
            self.stop()
        elif (then := dialog.press(key, character)) is not None:
            self.dialog = None
            then()

    def paste(self, text: str) -> None:
        """Take pasted text, if text is asked for."""
        if isinstance(self.dialog, Entry):
            self.dialog.insert(text)

    @property
    def viewer(self) -> str:
        """Name of an identity that may not command, "" for one that may."""
        who = self._identity
        return who.name if who is not None and not permits(who.role, "rpc/stop") else ""

    @property
    def pending(self) -> str:
        """What was asked of the daemon and is not confirmed."""
        if self._stopping.under_way:
            return "stop NOT confirmed" if self._stopping.late else "stopping..."
        return f"{self._command}..." if self._command else ""

    def follow(self) -> None:
        """Take note of what the daemon did meanwhile."""
        if why := self._session.lost():
            self._say(f"the lease is lost: {why}", alarming=True)
        state = None if self._feed.stale else self._state()
        if state is not None and self._stopping.confirm(state.state):
            self._say(f"stopped: the daemon says {state.state}")
        elif self._stopping.late and not self.message:
            self._say(
                "the daemon has not confirmed the stop: use the emergency stop", alarming=True
            )

    def _state(self) -> "BenchState | None":
        return self._feed.state()[0]

    def _say(self, text: str, *, alarming: bool = False) -> None:
        self.message, self.alarming = " ".join(text.split()), alarming

    def stop(self) -> None:
        """Stop the bench, whatever else is under way."""
        self.dialog = None
        if not self._may("stop"):
            return
        self._stopping.ask()
        self._say("")
        in_thread(self._stop)

    def _stop(self) -> None:
        try:
            self._session.client.stop()
        except ClientError as error:
            self._say(f"stop FAILED: {error}; use the emergency stop", alarming=True)
            return
        self._stopping.answered()

    def _may(self, rpc: str) -> bool:
        """Return whether our identity may call an RPC; say so if not."""
        who = self._identity
        if who is None or permits(who.role, f"rpc/{rpc}"):
            return True
        self._say(
            f"{who.name} is a {who.role} and may only watch: an operator's identity may command",
            alarming=True,
        )
        return False

    def _do(self, what: str, rpc: str, call: Callable[[], str]) -> None:
        """Carry out a command in a thread and say what became of it."""
        if not self._may(rpc):
            return
        if self._command:
            self._say(f"not done: {what}; still waiting for: {self._command}", alarming=True)
            return
        self._command = what
        self._say("")
        in_thread(lambda: self._carry_out(what, call))

    def _carry_out(self, what: str, call: Callable[[], str]) -> None:
        try:
            outcome, alarming = call(), False
        except ClientError as error:
            outcome, alarming = f"{what}: {refusal_text(error)}", True
        except Exception as error:  # what fails here must not end the screen
            outcome, alarming = f"{what}: {error}", True
        self._command = ""
        self._say(outcome, alarming=alarming)

    def pause_or_resume(self) -> None:
        """Pause the plan, or go on with it."""
        state = self._state()
        plan = state.plan if state is not None else None
        if plan is None or plan.over:
            self._say("no plan is under way: `motord plan start NAME` starts one")
        elif plan.state in ("paused", "pausing"):
            self._do("resume", "plan/resume", lambda: self._plan(Commander.resume_plan))
        else:
            self._do("pause", "plan/pause", lambda: self._plan(Commander.pause_plan))

    def _plan(self, ask: Callable[[Commander], PlanProgress]) -> str:
        reply = self._session.command(ask)
        return f"{reply.plan}: {reply.state}"

    def abort(self) -> None:
        """Abort the plan, once that is confirmed."""
        state = self._state()
        if state is None or state.plan is None or state.plan.over:
            self._say("no plan is under way")
            return
        self.dialog = Confirmation(
            f"Abort {state.plan.plan}? The bench ramps down and is disabled.",
            lambda: self._do("abort", "plan/abort", lambda: self._plan(Commander.abort_plan)),
        )

    def note(self) -> None:
        """Ask for a note."""
        if self._may("note"):
            self.dialog = Entry("Note:", self._note, NOTE_LENGTH)

    def _note(self, text: str) -> None:
        def note() -> str:
            where = self._session.client.note(text).recording
            return f"noted in {where or 'the events alone: nothing is being recorded'}"

        self._do("note", "note", note)

    def _change_state(
        self, rpc: str, ask: Callable[[Commander], StateReply], *, keep: bool = False
    ) -> None:
        """Enable, disable or reset; `keep` the lease."""
        self._do(rpc, rpc, lambda: f"{rpc}: {self._session.command(ask, keep=keep).state}")

    def torque(self) -> None:
        """Ask for the torque."""
        if self._may("set"):
            self.dialog = Entry("Torque in Nm:", self._set_torque, NUMBER_LENGTH, STOP_LETTERS)

    def _set_torque(self, text: str) -> None:
        try:
            torque_Nm = float(text.replace(",", "."))
        except ValueError:
            self._say(f"'{text}' is no torque in Nm: nothing is set", alarming=True)
            return

        def set_torque() -> str:
            asked = self._session.command(lambda who: who.set(torque_Nm=torque_Nm), keep=True)
            return set_text(asked)

        self._do(f"set {torque_Nm:g} Nm", "set", set_torque)

    def take_or_give(self) -> None:
        """Take the lease, ask before taking it over; or give it back."""
        state = self._state()
        holder = state.lease.holder if state is not None else None
        if self._session.holds and state is not None and state.state == "ENABLED":
            question = "Give the lease back? The bench ramps down and is disabled."
            self.dialog = Confirmation(question, self._give)
        elif self._session.holds:
            self._give()
        elif holder:
            question = f"{holder} has the lease. Take it over?"
            self.dialog = Confirmation(question, lambda: self._take(force=True))
        else:
            self._take(force=False)

    def _take(self, *, force: bool) -> None:
        def take() -> str:
            self._session.take(force=force)
            return "the lease is held here"

        self._do("lease", "lease/acquire", take)

    def _give(self) -> None:
        def give() -> str:
            self._session.give()
            return "the lease was given back"

        self._do("give the lease back", "lease/release", give)

    def scroll(self, step: int) -> None:
        """Show older (positive) or newer events."""
        self.events_back = min(max(self.events_back + step, 0), len(self._feed.events()))

    def help(self) -> None:
        """Show the keys."""
        self.dialog = Help()

    def quit(self) -> None:
        """End; ask first if that ramps the bench down."""
        state = self._state()
        if self._session.holds and state is not None and state.state == "ENABLED":
            question = "The lease is held here: the bench ramps down. Quit?"
            self.dialog = Confirmation(question, self._leave)
        else:
            self._leave()
