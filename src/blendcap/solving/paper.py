"""The papers' solve: Eq. 3 of Reading Between the Dots (2016), Eq. 33 of the thesis (2017)."""

from __future__ import annotations

import numpy as np

from blendcap.data import Certificate
from blendcap.numerics.boxls import solve_box
from blendcap.numerics.boxseq import solve_box_sequence
from blendcap.solving.curves import Curves
from blendcap.solving.rows import MarkerRows

BETA, GAMMA = 0.3, 0.001  # mm²: the price of the sum of weights, and a ridge that makes the optimum unique
INFLUENCE = 4.0  # mm²: the papers' largest gamma of a curve


def solve_paper(
    rows: MarkerRows,
    beta: float,
    gamma: float,
    coupling: float = 0.0,
    curves: Curves | None = None,
    influence: float = INFLUENCE,
) -> tuple[np.ndarray, dict[str, np.ndarray], Certificate]:
    """Minimise `|B0 + B a - T|² + beta |a|_1 + a' Gamma a` over `0 <= a <= 1` in every frame (Eq. 3).

    With curves, `sum_i gamma_i (a_i - ã_i)²` joins it (Eq. 4, Eq. 38 of the thesis); gamma_i is `influence` where a
    curve is fully trusted.

    Unsigned helmet columns (the thesis' dummy shapes, 4.1.6) are charged by beta as the shapes are; signed ones, which
    the papers do not have, by gamma alone.

    Parameters
    ----------
    rows : MarkerRows
    beta, gamma : float
        mm².
    coupling : float
        λ of λ |a_t - a_(t-1)|², mm²; 0 solves every frame on its own.
    curves : Curves, optional
    influence : float
        Largest gamma_i, mm².

    Returns
    -------
    unknowns : (T, N + K)
    energies : {term: (T,)}
        mm².
    certificate : Certificate
    """
    size = len(rows.lower)
    gram = rows.gram + gamma * np.eye(size)
    signed = rows.lower < 0  # |a| is linear only where a has one sign; signed helmet unknowns are not charged
    linear = rows.linear + np.where(signed, 0.0, beta / 2)
    limits = {"lower": rows.lower, "upper": rows.upper, "rows": rows.rows, "missing": rows.missing}
    if curves is not None:
        limits["diagonal"], pull = curves.terms(influence, size)
        linear = linear + pull
    if coupling > 0:
        unknowns, certificate = solve_box_sequence(gram, linear, np.full(size, coupling), **limits)
    else:
        unknowns, certificate = solve_box(gram, linear, **limits)
    steps = np.diff(unknowns, axis=0, prepend=unknowns[:1])
    energies = {
        "markers": np.nansum(rows.errors(unknowns) ** 2, axis=1),
        "sparsity": beta * unknowns[:, ~signed].sum(1),
        "ridge": gamma * (unknowns**2).sum(1),
        "smoothness": coupling * (steps**2).sum(1),
    }
    if curves is not None:
        energies["curves"] = curves.energy(unknowns[:, : rows.shapes], influence)
    return unknowns, energies, certificate
