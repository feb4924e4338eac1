"""The report of an alignment: what was found, how the rotor followed, what the zero rests on."""

from motord.experiments.alignment.plots import followed, rests, torque_sign
from motord.experiments.alignment.result import Alignment
from motord.experiments.subject import Recordings
from motord.report.html import Page


def report(result: Alignment, recordings: Recordings) -> Page:
    """Return a page of its own."""
    page = Page("Phase order, encoder direction and zero", recordings.subject.lead)
    page.table([], recordings.facts)
    fill(page, result)
    return page


def fill(page: Page, result: Alignment) -> None:
    """Add the alignment to a page."""
    page.heading("Encoder and phases, found by turning a current vector")
    page.table(
        ["[motor]", "found", "bench file"],
        [[name, str(new), str(result.configured[name])] for name, new in result.fields.items()],
    )
    page.points(
        [
            f"Zero known to \u00b1{result.offset_half_width_points:.2g} encoder points (95 %), "
            "and to a whole electrical turn.",
            f"[accuracy] encoder_zero_rad = {result.accuracy_fields['encoder_zero_rad']}: the "
            "limit of a rectangular distribution with the zero's combined standard uncertainty, "
            "that of the rests and that of the encoder's own error.",
            f"The rotor turns 1/{result.pole_pairs:.3f} of a turn for each electrical turn.",
            f"Friction leaves {1e3 * result.friction_Nm:.0f} mNm at rest, RMS, which takes a "
            f"single stop {result.friction_points:.2f} encoder points off.",
            f"{result.agreement[0].upper()}{result.agreement[1:]}.",
        ]
    )
    page.picture(
        followed(result.rests),
        "Where the rotor was at each stop of the current vector. It goes down where the encoder "
        "counts against the order of the phases; the slope is one over the pole pairs.",
    )
    page.picture(
        rests(result),
        "How far the rotor rested from where the vector alone would take it, in encoder points, "
        "and the residual of the fit, which takes cogging torque, unequal currents and their "
        "offsets into account: friction.",
    )
    response = result.torque_response
    page.picture(
        torque_sign(response.motion_Nm, response.torque_Nm),
        "Torque that the rotor's oscillations take, by its inertia and damping, and the torque "
        f"that the sensor measured: {100 * response.explained[0]:.0f} % of its variance. A rising "
        "line: forwards is the direction of positive torque.",
    )
