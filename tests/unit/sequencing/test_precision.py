"""What a plan may end early by."""

import pytest

from motord.sequencing.observation import Precision

BOTH = {"alpha_percent": 0.1, "beta_A": 0.02}
KNOWN = {"alpha_percent": 0.1, "beta_A": 0.015, "cogging_percent": 7.0}


@pytest.mark.parametrize(
    ("half_widths", "obstacle", "targets", "reached"),
    [
        (KNOWN, "", BOTH, True),
        (KNOWN, "", {"beta_A": 0.015}, True),
        (KNOWN, "", {"beta_A": 0.0149}, False),
        (KNOWN, "", {**BOTH, "cogging_percent": 1.0}, False),
        (KNOWN, "", {**BOTH, "ripple_percent": 100.0}, False),
        (KNOWN, "findings: back-emf", BOTH, False),
        (KNOWN, "", {}, False),
        ({}, "", BOTH, False),
        ({**KNOWN, "beta_A": float("nan")}, "", BOTH, False),
    ],
)
def test_targets_are_reached_when_all_are_and_nothing_is_in_the_way(
    half_widths: dict[str, float], obstacle: str, targets: dict[str, float], reached: bool
) -> None:
    assert Precision(5, half_widths, obstacle).reaches(targets) is reached


@pytest.mark.parametrize(
    ("precision", "expected"),
    [
        (Precision(5, KNOWN), "alpha_percent 0.1 of 0.1, beta_A 0.015 of 0.02"),
        (Precision(1, {"beta_A": 0.12345}), "alpha_percent ? of 0.1, beta_A 0.12 of 0.02"),
        (Precision(1, {}, "few turns"), "alpha_percent ? of 0.1, beta_A ? of 0.02, few turns"),
    ],
)
def test_what_is_known_stands_next_to_what_is_wanted(precision: Precision, expected: str) -> None:
    assert precision.to_text(BOTH) == expected
