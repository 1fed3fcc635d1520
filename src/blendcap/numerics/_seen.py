"""The Gram matrix of the markers that a frame sees, kept up to date along a run of frames."""

from __future__ import annotations

import numpy as np
from numba import njit

from blendcap.numerics._cholesky import FAST

REBUILD = 256  # rank-one updates after which the matrix is formed anew, against drift


@njit(error_model="numpy", cache=True)
def seen_start(gram, missing):
    """A copy of the Gram matrix to work on, the markers that it lacks, and the updates since it was formed."""
    copies = 1 if missing.shape[1] else 0
    return gram[: gram.shape[0] * copies].copy(), np.zeros(missing.shape[1], np.bool_), np.zeros(1, np.int64)


@njit(fastmath=FAST, error_model="numpy", cache=True)
def seen_gram(seen, gram, rows, missing, t):
    """The Gram matrix of the markers that frame t sees, by rank-one updates of the one of the frame before."""
    h, lacks, updates = seen
    if not lacks.size:
        return gram
    flips = 0
    for k in range(lacks.size):
        flips += lacks[k] != missing[t, k]
    updates[0] += flips * rows.shape[1]
    if updates[0] > REBUILD:
        for i in range(h.shape[0]):
            for j in range(h.shape[1]):
                h[i, j] = gram[i, j]
        for k in range(lacks.size):
            lacks[k] = False
        updates[0] = 0
    for k in range(lacks.size):
        if lacks[k] != missing[t, k]:
            sign = 1.0 if lacks[k] else -1.0
            lacks[k] = missing[t, k]
            for p in range(rows.shape[1]):
                r = rows[k, p]
                for i in range(h.shape[0] - 1):
                    c = sign * r[i]
                    if c != 0:
                        for j in range(r.size):
                            h[i, j] += c * r[j]
    return h
