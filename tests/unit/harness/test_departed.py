"""What a campaign of departures counts as kept: each figure by itself, findings, refusals."""

from typing import Any

import pytest

from motord.findings import Finding
from motord.identification import IdentifyError
from tests.campaigns.departed import Trial, attempted, judge

NAMED = Finding("named", 1.0, 0.5, "Nm", "serious", "meaning", "action")
TRIALS = 20


def trials(missed: int = 0, named: int = TRIALS, refused: int = 0) -> list[Trial | None]:
    """Return trials of two figures of which so many do not hold the second, or are not named."""
    some = [
        Trial({"one": True, "other": n >= missed}, [NAMED] * (n < named))
        for n in range(TRIALS - refused)
    ]
    return [*some, *[None] * refused]


@pytest.mark.parametrize(
    ("some", "expected", "kept"),
    [
        (trials(), {}, True),
        (trials(missed=3), {}, True),
        (trials(missed=4), {}, False),  # of both figures together 90 % are held
        (trials(missed=4), {"lost": ("other",)}, True),
        (trials(), {"named": "named"}, True),
        (trials(named=19), {"named": "named"}, False),
        (trials(named=17), {"named": "named", "power": 0.95}, True),
        (trials(named=16), {"named": "named", "power": 0.95}, False),
        (trials(refused=1), {}, False),
        (trials(refused=1), {"refused": True}, True),
        (trials(refused=TRIALS), {"refused": True}, False),
    ],
)
def test_a_departure_is_kept(
    some: list[Trial | None],
    expected: dict[str, Any],
    kept: bool,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert judge("bench", some, **expected) is kept
    assert ("NOT KEPT" in capsys.readouterr().out) is not kept


def test_a_refusal_is_no_trial() -> None:
    def refuse(_: int) -> Trial:
        raise IdentifyError("too few")

    assert attempted(refuse, 1) is None
