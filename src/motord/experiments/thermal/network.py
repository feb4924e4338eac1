"""The thermal network: nodes with heat capacity, thermal resistances between them and the ambient.

    C_i dT_i/dt = P_i - sum_j G_ij (T_i - T_j) - G_i0 (T_i - T_0)

P, the copper loss, enters the first node. The loss follows the measured temperature of that node,
so the network is linear in it: each of its modes is a first-order filter, exact for heat that is
constant over a step.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from motord.experiments.thermal.recursion import recur

AMBIENT = "ambient"

LINKS = {
    ("winding",): (("winding", AMBIENT),),
    ("magnet",): (("magnet", AMBIENT),),
    ("housing",): (("housing", AMBIENT),),
    ("winding", "housing"): (("winding", "housing"), ("housing", AMBIENT)),
    ("winding", "magnet"): (("winding", "magnet"), ("winding", AMBIENT)),
    ("winding", "magnet", "housing"): (
        ("winding", "housing"),
        ("winding", "magnet"),
        ("magnet", "housing"),
        ("housing", AMBIENT),
    ),
}
"""Between what there are thermal resistances, by the nodes that are measured."""


@dataclass(frozen=True)
class LumpedNetwork:
    """A network: capacity_J_per_K (n,) of its nodes, conductance_W_per_K (m,) of its links.

    Where the resistance of the winding is not known heat is in A^2, so both are per ohm.
    """

    nodes: tuple[str, ...]
    capacity_J_per_K: np.ndarray
    conductance_W_per_K: np.ndarray

    @property
    def links(self) -> Sequence[tuple[str, str]]:
        """What the conductances are between."""
        return LINKS[self.nodes]

    @cached_property
    def laplacian_W_per_K(self) -> np.ndarray:
        """Heat that leaves each node (n, n) by the temperatures above ambient."""
        matrix = np.zeros((len(self.nodes), len(self.nodes)))
        for (one, other), conductance in zip(self.links, self.conductance_W_per_K, strict=True):
            i = self.nodes.index(one)
            matrix[i, i] += conductance
            if other != AMBIENT:
                j = self.nodes.index(other)
                matrix[j, j] += conductance
                matrix[i, j] -= conductance
                matrix[j, i] -= conductance
        return matrix

    def rates_per_s(self, feedback_W_per_K: float = 0.0) -> np.ndarray:
        """Return the rates (n,) at which its modes decay, the slowest first.

        feedback_W_per_K: by how much the loss rises with the temperature of the first node.
        """
        matrix = self.laplacian_W_per_K.copy()
        matrix[0, 0] -= feedback_W_per_K
        root = np.sqrt(self.capacity_J_per_K)
        return np.asarray(np.linalg.eigvalsh(matrix / np.outer(root, root)))

    def steady_rise_K(self, heat_W: float, feedback_W_per_K: float = 0.0) -> np.ndarray:
        """Return the steady temperatures above ambient (n,) with heat in the first node."""
        matrix, heat = self.laplacian_W_per_K.copy(), np.zeros(len(self.nodes))
        matrix[0, 0] -= feedback_W_per_K
        heat[0] = heat_W
        return np.asarray(np.linalg.solve(matrix, heat))

    def temperatures_C(
        self, begin_C: np.ndarray, heat_W: np.ndarray, ambient_C: np.ndarray, step_s: float
    ) -> np.ndarray:
        """Return the temperatures (k + 1, n) at the ends of k steps, the beginning first.

        begin_C (n,); heat_W, ambient_C: (k,), constant over each step.
        """
        root = np.sqrt(self.capacity_J_per_K)
        rates, modes = np.linalg.eigh(self.laplacian_W_per_K / np.outer(root, root))
        rates = np.maximum(rates, 1e-12)
        into = modes.T / root  # heat of a node into each mode
        to_ambient_W_per_K = self.laplacian_W_per_K.sum(axis=1)
        gains = np.outer(into[:, 0], heat_W) + np.outer(into @ to_ambient_W_per_K, ambient_C)
        keep = np.exp(-rates * step_s)
        found = np.empty((rates.size, heat_W.size + 1))  # each mode contiguous
        found[:, 0] = modes.T @ (root * begin_C)
        found[:, 1:] = ((1 - keep) / rates)[:, None] * gains
        for mode, course in enumerate(found):
            recur(course, keep[mode : mode + 1])
        return np.asarray((modes @ found / root[:, None]).T)
