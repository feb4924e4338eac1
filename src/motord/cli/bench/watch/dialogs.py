"""What the screen asks, drawn over its lower lines; keys come one after the other, none is lost.

`press` returns what is to be done once the dialog is over, None before; `stops` are keys that stop
the bench. So does Escape, which never gets here, and closes the dialog.
"""

from collections.abc import Callable
from dataclasses import dataclass

from rich.text import Text

from motord.cli.bench.watch import keys

STOP_LETTERS = frozenset({"s", "S", "space"})
NUMBER_LENGTH = 16
NOTE_LENGTH = 1000


def _nothing() -> None:
    """Do nothing: the dialog was given up."""


@dataclass
class Confirmation:
    """A question: y does it, every other key does not."""

    question: str
    then: Callable[[], object]
    stops: frozenset[str] = frozenset({"s", "S"})

    def lines(self) -> list[Text]:
        """Return question and keys."""
        answers = "y: yes   any other key: no   Escape, s: stop the bench"
        return [Text(self.question, "bold"), Text(answers)]

    def press(self, key: str, character: str | None) -> Callable[[], object] | None:
        """Answer."""
        return self.then if key in ("y", "Y") else _nothing


@dataclass
class Entry:
    """A line of text."""

    prompt: str
    then: Callable[[str], object]
    length: int
    stops: frozenset[str] = frozenset()
    text: str = ""

    def lines(self) -> list[Text]:
        """Return prompt, text and keys."""
        stop = "Escape, s, Space" if self.stops else "Escape"
        entered = Text.assemble(f"{self.prompt} ", (self.text[-50:], "bold"), ("_", "blink"))
        return [entered, Text(f"Enter: done (empty: nothing)   {stop}: stop the bench")]

    def press(self, key: str, character: str | None) -> Callable[[], object] | None:
        """Take a key of the line."""
        if key == "enter":
            text = self.text.strip()
            return (lambda: self.then(text)) if text else _nothing
        if key in ("backspace", "delete", "ctrl+h"):
            self.text = self.text[:-1]
        elif key == "ctrl+u":
            self.text = ""
        elif character is not None:
            self.insert(character)
        return None

    def insert(self, text: str) -> None:
        """Take characters, also pasted ones, as far as they can be printed and there is room."""
        printable = "".join(one for one in text if one.isprintable())
        self.text = (self.text + printable)[: self.length]


@dataclass
class Help:
    """The keys."""

    stops: frozenset[str] = frozenset({"s", "S"})

    def lines(self) -> list[Text]:
        """Return the keys with what they do."""
        listed = [
            Text.assemble((f"{keys.names(key):<17}", "bold"), key.meaning) for key in keys.KEYS
        ]
        return [*listed, Text("Escape, s: stop the bench   any other key: close")]

    def press(self, key: str, character: str | None) -> Callable[[], object] | None:
        """Close."""
        return _nothing


Dialog = Confirmation | Entry | Help
