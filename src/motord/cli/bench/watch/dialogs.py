"""What the screen asks. Escape stops the bench in each of them: see `app`."""

from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.events import Key
from textual.screen import ModalScreen
from textual.widgets import Input, Static

from motord.cli.bench.watch import keys

CSS = """
ModalScreen { align: center bottom; background: transparent; }
ModalScreen > Vertical {
    width: 76; max-width: 100%; height: auto; max-height: 100%; padding: 0 1;
    border: ascii ansi_default; background: ansi_default; color: ansi_default;
}
ModalScreen Static { background: ansi_default; color: ansi_default; height: auto; }
ModalScreen Input, ModalScreen Input:focus {
    background: ansi_default; color: ansi_default; border: none; height: 1; padding: 0;
}
"""


class Confirmation(ModalScreen[bool]):
    """A question that `y` answers with yes and every other key with no."""

    def __init__(self, question: str) -> None:
        super().__init__()
        self._question = question

    def compose(self) -> ComposeResult:
        """Return question and keys."""
        with Vertical():
            yield Static(Text(self._question))
            yield Static(Text("y: yes   any other key: no   Escape: stop the bench", "bold"))

    def on_key(self, event: Key) -> None:
        """Answer."""
        event.stop()
        self.dismiss(event.key in ("y", "Y"))


class Entry(ModalScreen[str]):
    """A line of text; "" if it was given up. With `stops`, keys that end it and stop the bench."""

    def __init__(self, prompt: str, stops: tuple[str, ...] = (), max_length: int = 0) -> None:
        super().__init__()
        self._prompt = prompt
        self._stops = stops
        self._max_length = max_length

    def compose(self) -> ComposeResult:
        """Return prompt and input."""
        stop = "Escape, s, Space" if self._stops else "Escape"
        with Vertical():
            yield Static(Text(self._prompt))
            yield _Line(self._stops, self._max_length)
            yield Static(Text(f"Enter: done (empty: give up)   {stop}: stop the bench", "bold"))

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Answer."""
        self.dismiss(event.value.strip())


class _Line(Input):
    """An input without the keys that stop the bench."""

    def __init__(self, stops: tuple[str, ...], max_length: int) -> None:
        super().__init__(max_length=max_length, select_on_focus=False)
        self._stops = stops

    async def _on_key(self, event: Key) -> None:
        if event.key in self._stops:
            event.stop()
            event.prevent_default()
            await self.app.run_action("stop")
            return
        await super()._on_key(event)


class Help(ModalScreen[None]):
    """The keys."""

    def compose(self) -> ComposeResult:
        """Return the keys with what they do."""
        with Vertical():
            for key in keys.KEYS:
                yield Static(Text.assemble((f"{keys.names(key):<17}", "bold"), key.meaning))
            yield Static(Text("Escape: stop the bench   any other key: close", "bold"))

    def on_key(self, event: Key) -> None:
        """Close."""
        event.stop()
        self.dismiss()
