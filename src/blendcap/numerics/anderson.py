"""Anderson acceleration: a fixed-point iteration reaches in a few steps what it would creep to in many."""

from __future__ import annotations

import numpy as np

GROWN = 2.0  # a residual this much larger than the last one means that the memory misleads


class Anderson:
    """Accelerates `x <- g(x)` from the last few steps.

    The next point is the combination of the remembered images `g(x_j)` whose residual `g(x_j) - x_j` would be least if
    residuals were linear. Anderson (1965), "Iterative procedures for nonlinear integral equations", J. ACM 12(4),
    doi:10.1145/321296.321305; for closest-point iterations see Zhang, Yao and Deng (2021), "Fast and robust iterative
    closest point", IEEE PAMI 44(7), doi:10.1109/TPAMI.2021.3054619.

    Parameters
    ----------
    memory : int
        How many earlier steps are combined; 0 leaves the iteration plain.
    """

    def __init__(self, memory: int):
        self.memory = memory
        self.forget()

    def forget(self) -> None:
        """Start anew, as when the map g changes."""
        self._images: list[np.ndarray] = []
        self._residuals: list[np.ndarray] = []

    def step(self, image: np.ndarray, residual: np.ndarray) -> np.ndarray:
        """The next point, of the shape of `image` = g(x); `residual` is any linear view of g(x) - x."""
        residual = residual.ravel()
        if self._residuals and np.linalg.norm(residual) > GROWN * np.linalg.norm(self._residuals[-1]):
            self.forget()
        self._images = [*self._images, image][-self.memory - 1 :]
        self._residuals = [*self._residuals, residual][-self.memory - 1 :]
        if len(self._residuals) < 2 or not self.memory:
            return image
        steps = np.diff(np.stack(self._residuals), axis=0)
        gram = steps @ steps.T
        gram[np.diag_indices_from(gram)] *= 1 + 1e-10
        share = np.linalg.lstsq(gram, steps @ residual, rcond=None)[0]
        return image - np.tensordot(share, np.diff(np.stack(self._images), axis=0), 1)
