"""The keys of the screen, in one table: bindings, footer, help and docs/watch.md are made of it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class KeyBinding:
    """Keys (names of Textual) that do `action`; `label` is for the footer, "" if not there."""

    keys: tuple[str, ...]
    action: str
    label: str
    meaning: str


KEYS = (
    KeyBinding(
        ("s", "space", "escape"), "stop", "Stop",
        "zero current now, and OFF, whoever has the lease",
    ),
    KeyBinding(("p",), "pause", "Pause", "pause the plan (ramps to zero), or resume it"),
    KeyBinding(("a",), "abort", "Abort", "abort the plan: ramps down, disables; asks first"),
    KeyBinding(("n",), "note", "Note", "put a note into events and recording"),
    KeyBinding(("r",), "reset", "Reset", "leave a trip whose cause is gone; start the loop anew"),
    KeyBinding(("l",), "lease", "Lease", "take the lease, or give it back; asks to take over"),
    KeyBinding(("e",), "enable", "Enable", "enable at zero torque, and keep the lease"),
    KeyBinding(("d",), "disable", "Disable", "ramp the torque to zero, then disable"),
    KeyBinding(("t",), "torque", "Torque", "set the torque, and keep the lease"),
    KeyBinding(("up",), "older", "", "look at older events"),
    KeyBinding(("down",), "newer", "", "go back to newer ones"),
    KeyBinding(("end",), "newest", "", "go back to the newest"),
    KeyBinding(("q", "ctrl+c"), "quit", "Quit", "quit; asks first if the bench ramps down then"),
    KeyBinding(("question_mark", "h", "f1"), "help", "?", "show this list"),
)  # fmt: skip
ACTIONS = {
    case: key.action
    for key in KEYS
    for one in key.keys
    for case in ({one, one.upper()} if len(one) == 1 else {one})
}
"""Action by name of a key. Letters count in both cases: a caps lock must not prevent a stop."""

_NAMES = {"escape": "Escape", "space": "Space", "question_mark": "?", "ctrl+c": "Ctrl-C"}


def names(key: KeyBinding) -> str:
    """Return the keys as people call them: `s, Space, Escape`."""
    return ", ".join(_NAMES.get(one, one if len(one) == 1 else one.title()) for one in key.keys)
