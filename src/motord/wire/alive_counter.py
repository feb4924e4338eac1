"""Which frames of a message are new, by its alive counter; errors are counted as elsewhere.

A frame whose counter steps back (more than half a turn ahead is the same) is an old one: repeated
or overtaken on the way. What repeats a drive's last frames keeps no feedback fresh so.
"""

from motord.wire.bridge.sequence import SequenceCheck

RESTART_FRAMES = 8
"""Old frames in a row, each one ahead of the one before, that show a sender which started anew. One
that counts with four bits is back in step by then; it has no more old frames that look old."""


class AliveCounter:
    """Follows the counter of a message modulo `modulus` (0: it has none, every frame is new)."""

    def __init__(self, modulus: int) -> None:
        self._check = SequenceCheck(modulus)
        self._modulus = modulus
        self._newest = self._behind = -1
        self._in_a_row = 0

    @property
    def errors(self) -> int:
        """Return the frames lost, corrupt or old so far; it never falls."""
        return self._check.errors

    def corrupt(self) -> None:
        """Count a frame whose content cannot be trusted."""
        self._check.corrupt()

    def restart(self) -> None:
        """Take the next frame as the first of a new stream."""
        self._check.restart()

    def accept(self, number: int) -> bool:
        """Count what is missing before a good frame; False if it is an old one, an error itself."""
        taken = self._check.accept(number, may_restart=False)
        if not taken and self._starts_anew(number):
            self._check.restart()
            taken = self._check.accept(number)
        if taken:
            self._newest, self._in_a_row = number, 0
        return taken

    def _starts_anew(self, number: int) -> bool:
        """Return whether an old frame and those before it are a new stream.

        Not with the newest frame that was taken: with it ends what is repeated.
        """
        follows = self._in_a_row > 0 and number == (self._behind + 1) % self._modulus
        self._in_a_row = self._in_a_row + 1 if follows else 1
        self._behind = number
        return self._in_a_row >= RESTART_FRAMES and number != self._newest
