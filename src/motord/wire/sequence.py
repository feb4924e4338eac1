"""How many frames of a numbered stream were lost or corrupt, each counted once, and which are new.

A corrupt frame is seen twice: when its checksum fails, and as a gap at the next good one. The
larger of the two counts between good frames is what went wrong there.

A frame whose counter steps back (more than half a turn ahead is the same) is an old one: repeated
or overtaken on the way. What repeats a drive's last frames keeps no feedback fresh so.
"""


class SequenceCheck:
    """Follows frames numbered modulo `modulus` (0: not numbered, only corrupt ones count)."""

    def __init__(self, modulus: int) -> None:
        self._modulus = modulus
        self.reset()

    def reset(self) -> None:
        """Start anew, without errors."""
        self._expected = -1
        self._corrupt = self._errors = 0

    @property
    def errors(self) -> int:
        """Return the frames lost, corrupt or repeated since the start or `reset`."""
        return self._errors + self._corrupt

    def corrupt(self) -> None:
        """Count a frame whose content cannot be trusted."""
        self._corrupt += 1

    def accept(self, number: int, *, may_restart: bool = True) -> bool:
        """Count what is missing before a good frame; False if it repeats the one before it.

        A step back, or more than half a turn ahead, is a sender that started anew: one error. If
        not `may_restart` it is an old frame: one error, and False.
        """
        modulus = self._modulus
        if not modulus:
            self._settle(0)
            return True
        if self._expected < 0:
            missing = 0
        else:
            missing = (number - self._expected) % modulus
            steps_back = missing > modulus // 2
            if missing == modulus - 1 or (steps_back and not may_restart):
                self._corrupt += 1
                return False
            if steps_back:
                missing = 1
        self._expected = (number + 1) % modulus
        self._settle(missing)
        return True

    def restart(self) -> None:
        """Take the next frame as the first of a new stream."""
        self._expected = -1

    def _settle(self, missing: int) -> None:
        self._errors += max(missing, self._corrupt)
        self._corrupt = 0


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
