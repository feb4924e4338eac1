"""A board's clock of which it is seen how often it began anew."""

from motord.hal.bridge.clock import BoardClock


class CountedClock(BoardClock):
    def __init__(self) -> None:
        super().__init__()
        self.resets = 0

    def reset(self) -> None:
        self.resets += 1
        super().reset()
