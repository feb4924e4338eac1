"""What passes between the supervisor and the estimator process, each a JSON object on a line.

From the supervisor comes first `{"do": "start", "run", "estimator", "targets", "options"}`, then
for each capture `{"do": "point", "content"}` with what the topic `/operating_point` says of it; it
is answered by a `PrecisionReport`.
"""

import math
from typing import Annotated

from pydantic import Field

from motord.recorder.protocol import Count, Message, Text
from motord.sequencing.observation import Precision

QUANTITIES_MAX = 64
NAME_MAX = 100
TEXT_MAX = 1000

Name = Annotated[str, Field(max_length=NAME_MAX)]
HalfWidth = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class PrecisionReport(Message):
    """How well the captures so far give what the plan is to find out: a `Precision`.

    run: that of the command to start.
    """

    run: Text
    captures: Count
    half_widths: Annotated[dict[Name, HalfWidth], Field(max_length=QUANTITIES_MAX)]
    obstacle: Annotated[str, Field(max_length=TEXT_MAX)]
    remark: Annotated[str, Field(max_length=TEXT_MAX)] = ""

    @classmethod
    def of(cls, run: str, precision: Precision) -> "PrecisionReport":
        """Return the report of a precision; a half-width that is not finite is not known."""
        known = {
            name: float(half) for name, half in precision.half_widths.items() if math.isfinite(half)
        }
        return cls(
            run=run,
            captures=precision.captures,
            half_widths=known,
            obstacle=precision.obstacle[:TEXT_MAX],
            remark=precision.remark[:TEXT_MAX],
        )

    @property
    def precision(self) -> Precision:
        """What is reported."""
        return Precision(self.captures, self.half_widths, self.obstacle, self.remark)
