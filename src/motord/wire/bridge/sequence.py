"""How many frames of a numbered stream were lost or corrupt, each counted once.

A corrupt frame is seen twice: when its checksum fails, and as a gap at the next good one. The
larger of the two counts between good frames is what went wrong there.
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
