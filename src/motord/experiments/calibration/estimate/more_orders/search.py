"""Cogging orders beyond those that slots and poles allow, where the data show them.

Forward selection: all orders of the turn are tried, the best enters, and again with it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from motord.experiments.calibration.estimate.more_orders.problem import Weighted
from motord.experiments.calibration.estimate.more_orders.trial import (
    FALSE_SHARE,
    TOLERANCE,
    OrderTrial,
    tried,
)

FIRST_ORDER = 2
"""Lowest order that is tried: mean and slope of each turn, which drift makes, are most of order 1.
"""

OFFSET_SHARE = 0.01
"""Part of the rated current that the offsets have to be known to with an order for it to enter."""

MAX_ADDED = 12
"""Orders that enter at most: each costs time and memory."""


@dataclass(frozen=True)
class Search:
    """Orders that entered, of all that were tried with their levels, over how many turns.

    imitated: those that did not, and that the currents' offsets can imitate. instead: pairs of an
    order that entered and one that would explain as much in its place. inseparable: orders that
    the data show, and with which the currents' offsets would not be known.
    """

    added: tuple[OrderTrial, ...]
    imitated: tuple[OrderTrial, ...]
    instead: tuple[tuple[int, int], ...]
    inseparable: tuple[int, ...]
    levels: Mapping[int, float]
    turns: int

    def without(self, orders: Sequence[int]) -> "Search":
        """Return the search with these orders out again."""
        return replace(
            self,
            added=tuple(one for one in self.added if one.order not in orders),
            instead=tuple(pair for pair in self.instead if pair[0] not in orders),
        )


def search(problem: Weighted, known: Sequence[int], pole_pairs: int) -> Search:
    """Return the orders that enter in addition to those that are `known`, by forward selection."""
    added: list[OrderTrial] = []
    rivals: list[tuple[int, int]] = []
    candidates = [o for o in range(FIRST_ORDER, problem.residual.shape[1] + 1) if o not in known]
    level = levels(candidates, pole_pairs)
    most_A = OFFSET_SHARE * problem.rated_A
    while True:
        trials = tried(problem, candidates)
        shown = [trial for trial in trials if trial.enters(level[trial.order])]
        good = [trial for trial in shown if trial.offset_stderr_A < most_A]
        if not good or len(added) == MAX_ADDED:
            break
        most = max(trial.gain for trial in good) - TOLERANCE
        near = [trial for trial in good if trial.gain >= most]
        # of several that explain as much, one that offsets imitate: it is seen at many orders
        best = min(near, key=lambda trial: (trial.clear, -trial.gain))
        added.append(best)
        rivals += [(best.order, trial.order) for trial in near if trial is not best]
        problem = problem.with_order(best.order)
        candidates.remove(best.order)
    rivals += [(trial.order, 0) for trial in shown if trial not in good]
    imitated = tuple(
        trial for trial in trials if _like_offsets(trial.order, pole_pairs) and not trial.clear
    )
    orders = {trial.order for trial in added}
    instead = tuple(pair for pair in rivals if pair[1] not in orders and 0 not in pair)
    inseparable = {pair[0] for pair in rivals if not pair[1]} - {pair[1] for pair in instead}
    return Search(tuple(added), imitated, instead, tuple(sorted(inseparable)), level, problem.turns)


def levels(orders: Sequence[int], pole_pairs: int) -> dict[int, float]:
    """Return the p-value below which each order enters; by chance any does in FALSE_SHARE.

    Half of that is for the orders that offsets of the currents have too (weighted Bonferroni):
    they are few, and one that is there and left out spoils the offsets.
    """
    like = [order for order in orders if _like_offsets(order, pole_pairs)]
    share = FALSE_SHARE / 2
    return {
        order: share / (len(like) if order in like else len(orders) - len(like)) for order in orders
    }


def _like_offsets(order: int, pole_pairs: int) -> bool:
    """Return whether offsets of the currents make torque of that order: p, 3 p, 5 p, ..."""
    return order % (2 * pole_pairs) == pole_pairs
