"""What is questionable about a driven rotor's motion, and what of the recordings was not used."""

from collections.abc import Iterator, Sequence

from motord.findings import Finding, listed
from motord.identification.left_out import PART, LeftOut

LEFT_OUT_SHARE = 0.1
"""Part of the recordings that may be left out, besides parts of a turn, without a finding."""


def left_out_finding(left_out: Sequence[LeftOut], used_s: float) -> Iterator[Finding]:
    """Yield a finding if much was left out; parts of a turn always are."""
    spans = [one for one in left_out if one.reason != PART]
    lost_s = sum(one.duration_s for one in spans)
    share = lost_s / max(used_s + lost_s, 1e-9)
    if share > LEFT_OUT_SHARE:
        reasons = sorted({one.reason for one in spans})
        yield Finding(
            "data-left-out", 100 * share, 100 * LEFT_OUT_SHARE, "%", "warning",
            f"{lost_s:.3g} s were not used: {', '.join(reasons)}; `left_out` lists each span",
            "drive at a steady speed for 3 turns or more in each direction",
        )  # fmt: skip


def left_out_lines(left_out: Sequence[LeftOut]) -> Iterator[str]:
    """Yield what was left out, a line for each reason."""
    for reason in sorted({one.reason for one in left_out}):
        spans = [one for one in left_out if one.reason == reason]
        where = listed([f"{one.begin_s:.1f}-{one.end_s:.1f} s" for one in spans])
        seconds = sum(one.duration_s for one in spans)
        yield f"left out, {reason}: {seconds:.1f} s ({where})"
