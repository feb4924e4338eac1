"""Orders per turn: those that sampling resolves, and those that slots and poles allow to cog."""

from math import gcd, lcm

SAMPLES_PER_ORDER = 2.5
"""Samples a turn that the highest order of a full spectrum needs."""

SAMPLES_PER_COGGING_ORDER = 2.4
"""The same where the allowed orders are fitted alone: less, for those between are left out."""

COUNTS_PER_COGGING_ORDER = 4
"""Encoder counts a turn that the highest order of a cogging table needs."""

ORDER_LIMIT = 512
"""Highest order that is looked at, where the main order allows."""

MAIN_MULTIPLES = 4
"""Multiples of the main order that are looked for."""

MAX_MULTIPLES = 12
"""Multiples of the pole number, and of the slot number, that are looked for at most."""


def periods_per_slot_pitch(slots: int, poles: int) -> int:
    """Return Np = 2p / HCF(Q, 2p), Poels 2008, eq. (3.1)."""
    return poles // gcd(slots, poles)


def main_order(slots: int, poles: int) -> int:
    """Return Q Np = LCM(Q, 2p): the order of a motor whose slots, and magnets, are all alike."""
    return slots * periods_per_slot_pitch(slots, poles)


def order_limit(slots: int, poles: int) -> int:
    """Return the highest order worth looking at: ORDER_LIMIT, or twice the main order if more."""
    return max(ORDER_LIMIT, 2 * main_order(slots, poles))


def resolved_order(
    samples_per_turn: int,
    counts: int,
    most: int,
    *,
    samples_per_order: float = SAMPLES_PER_ORDER,
    counts_per_order: int = 2,
) -> int:
    """Return the highest order up to `most` that samples and encoder resolve, 0 for none.

    It stays below half the counts, as Nyquist has it.
    """
    encoder = min((counts - 1) // 2, counts // counts_per_order)
    return min(most, int(samples_per_turn / samples_per_order), encoder)


def resolved_cogging_order(samples_per_turn: int, counts: int) -> int:
    """Return the highest order that a fit of the allowed orders alone resolves, 0 for none."""
    return resolved_order(
        samples_per_turn,
        counts,
        counts,
        samples_per_order=SAMPLES_PER_COGGING_ORDER,
        counts_per_order=COUNTS_PER_COGGING_ORDER,
    )


def allowed_orders(slots: int, poles: int, highest: int) -> tuple[int, ...]:
    """Return the orders up to `highest` at which slots and poles allow cogging torque, rising.

    Multiples of LCM(Q, 2p); of the pole number, which one dislocated slot adds (it meets every
    magnet once a turn); and of the slot number, which one dislocated magnet adds.
    """
    main = lcm(slots, poles)
    orders = {main * n for n in range(1, MAIN_MULTIPLES + 1)}
    for base in (poles, slots):
        multiples = min(2 * main // base, MAX_MULTIPLES)
        orders |= {base * n for n in range(1, multiples + 1)}
    return tuple(sorted(order for order in orders if order <= highest))
