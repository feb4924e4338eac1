"""The orders per turn at which a motor's slots and poles allow cogging torque."""

from math import gcd, lcm

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
