"""Cholesky factors of eight small matrices at once, one in each lane of the vectors.

A factor L is stored by panels of four rows: element (4 I + r, p) is the vector at `64 I (I + 1) + 32 p + 8 r`, so that
what one step of an inner loop reads lies together. The diagonal holds 1 / l_ii.
"""

from __future__ import annotations

from numba import njit

from blendcap.numerics._cholesky import TINY
from blendcap.numerics._lanes import fill, gather, load, rough_root, store, where_less


@njit(error_model="numpy", cache=True)
def eliminate(gram, free, n, d, a, y):
    """Factor the free blocks of `gram + diag d`, and solve `L y = y`; `free` lists n unknowns of every lane.

    Two panels take the products of a third while it is in the cache.
    """
    for i in range(0, n, 8):
        end = min(i + 8, n)
        for j in range(0, i, 4):
            for k in range(i, end, 4):
                reduce_block(gram, free, k, j, a, 16 * k * (k // 4 + 1), 16 * j * (j // 4 + 1))
        for k in range(i, end, 4):
            o = 16 * k * (k // 4 + 1)
            if k > i:
                reduce_block(gram, free, k, i, a, o, 16 * i * (i // 4 + 1))
            factor_corner(gram, free, k, d, a, o)
            forward_panel(a, o, k, y)


@njit(error_model="numpy", inline="always")
def element(gram, free, i, j):
    """The elements of gram at the i-th and the j-th free unknown of every lane."""
    rows, columns, _, _ = free
    return gather(gram, rows, 8 * i, columns, 8 * j)


@njit(error_model="numpy", inline="always")
def reduce_block(gram, free, i, j, a, o, c):
    """The 4 x 4 block at columns j of the panel at o: less the products of the columns before, then solved."""
    b = o + 32 * j
    s00, s10 = element(gram, free, i, j), element(gram, free, i + 1, j)
    s20, s30 = element(gram, free, i + 2, j), element(gram, free, i + 3, j)
    s01, s11 = element(gram, free, i, j + 1), element(gram, free, i + 1, j + 1)
    s21, s31 = element(gram, free, i + 2, j + 1), element(gram, free, i + 3, j + 1)
    s02, s12 = element(gram, free, i, j + 2), element(gram, free, i + 1, j + 2)
    s22, s32 = element(gram, free, i + 2, j + 2), element(gram, free, i + 3, j + 2)
    s03, s13 = element(gram, free, i, j + 3), element(gram, free, i + 1, j + 3)
    s23, s33 = element(gram, free, i + 2, j + 3), element(gram, free, i + 3, j + 3)
    for p in range(0, 32 * j, 32):
        c0, c1, c2, c3 = load(a, c + p), load(a, c + p + 8), load(a, c + p + 16), load(a, c + p + 24)
        u = load(a, o + p)
        s00, s01, s02, s03 = s00 - u * c0, s01 - u * c1, s02 - u * c2, s03 - u * c3
        u = load(a, o + p + 8)
        s10, s11, s12, s13 = s10 - u * c0, s11 - u * c1, s12 - u * c2, s13 - u * c3
        u = load(a, o + p + 16)
        s20, s21, s22, s23 = s20 - u * c0, s21 - u * c1, s22 - u * c2, s23 - u * c3
        u = load(a, o + p + 24)
        s30, s31, s32, s33 = s30 - u * c0, s31 - u * c1, s32 - u * c2, s33 - u * c3
    e = c + 32 * j
    solve_row(a, e, b, s00, s01, s02, s03)
    solve_row(a, e, b + 8, s10, s11, s12, s13)
    solve_row(a, e, b + 16, s20, s21, s22, s23)
    solve_row(a, e, b + 24, s30, s31, s32, s33)


@njit(error_model="numpy", inline="always")
def solve_row(a, e, b, s0, s1, s2, s3):
    """Solve one row against the factored corner at e and store it at b."""
    v0 = s0 * load(a, e)
    v1 = (s1 - v0 * load(a, e + 8)) * load(a, e + 40)
    v2 = (s2 - v0 * load(a, e + 16) - v1 * load(a, e + 48)) * load(a, e + 80)
    v3 = (s3 - v0 * load(a, e + 24) - v1 * load(a, e + 56) - v2 * load(a, e + 88)) * load(a, e + 120)
    store(a, b, v0)
    store(a, b + 32, v1)
    store(a, b + 64, v2)
    store(a, b + 96, v3)


@njit(error_model="numpy", inline="always")
def pivot(value):
    """A pivot, at least TINY, and its inverse."""
    value = where_less(value, fill(TINY), fill(TINY), value)
    return value, fill(1.0) / value


@njit(error_model="numpy", inline="always")
def inverse_root(value, inverse):
    """The square root of the inverse: Halley's step from single precision, half the time of a root and a division."""
    rough = rough_root(inverse)
    error = fill(1.0) - value * (rough * rough)
    return rough + rough * error * (fill(0.5) + fill(0.375) * error)


@njit(error_model="numpy", inline="always")
def factor_corner(gram, free, i, d, a, o):
    """The 4 x 4 block on the diagonal of the panel at o, less the products of its columns, then factored."""
    _, _, spots, none = free
    b = o + 32 * i
    s00 = element(gram, free, i, i) + gather(d, spots, 8 * i, none, 0)
    s10, s20, s30 = element(gram, free, i + 1, i), element(gram, free, i + 2, i), element(gram, free, i + 3, i)
    s11 = element(gram, free, i + 1, i + 1) + gather(d, spots, 8 * i + 8, none, 0)
    s21, s31 = element(gram, free, i + 2, i + 1), element(gram, free, i + 3, i + 1)
    s22 = element(gram, free, i + 2, i + 2) + gather(d, spots, 8 * i + 16, none, 0)
    s32 = element(gram, free, i + 3, i + 2)
    s33 = element(gram, free, i + 3, i + 3) + gather(d, spots, 8 * i + 24, none, 0)
    for p in range(o, b, 32):
        c0, c1, c2, c3 = load(a, p), load(a, p + 8), load(a, p + 16), load(a, p + 24)
        s00, s10, s20, s30 = s00 - c0 * c0, s10 - c1 * c0, s20 - c2 * c0, s30 - c3 * c0
        s11, s21, s31 = s11 - c1 * c1, s21 - c2 * c1, s31 - c3 * c1
        s22, s32, s33 = s22 - c2 * c2, s32 - c3 * c2, s33 - c3 * c3
    s00, r0 = pivot(s00)
    t1, t2, t3 = s10 * r0, s20 * r0, s30 * r0
    s11, s21, s31 = s11 - s10 * t1, s21 - s20 * t1, s31 - s30 * t1
    s11, r1 = pivot(s11)
    s22, s32, s33 = s22 - s20 * t2, s32 - s30 * t2, s33 - s30 * t3
    t2, t3 = s21 * r1, s31 * r1
    s22, s32 = s22 - s21 * t2, s32 - s31 * t2
    s22, r2 = pivot(s22)
    s33, r3 = pivot(s33 - s31 * t3 - s32 * (s32 * r2))
    d0, d1, d2 = inverse_root(s00, r0), inverse_root(s11, r1), inverse_root(s22, r2)
    store(a, b, d0)
    store(a, b + 8, s10 * d0)
    store(a, b + 16, s20 * d0)
    store(a, b + 24, s30 * d0)
    store(a, b + 40, d1)
    store(a, b + 48, s21 * d1)
    store(a, b + 56, s31 * d1)
    store(a, b + 80, d2)
    store(a, b + 88, s32 * d2)
    store(a, b + 120, inverse_root(s33, r3))


@njit(error_model="numpy", inline="always")
def forward_panel(a, o, i, y):
    """The four elements of y that belong to the panel at o."""
    s0, s1, s2, s3 = load(y, 8 * i), load(y, 8 * i + 8), load(y, 8 * i + 16), load(y, 8 * i + 24)
    t0 = t1 = t2 = t3 = fill(0.0)
    for p in range(0, i, 2):  # two sums each: a sum waits for the one before it
        u, v, b = load(y, 8 * p), load(y, 8 * p + 8), o + 32 * p
        s0, s1 = s0 - u * load(a, b), s1 - u * load(a, b + 8)
        s2, s3 = s2 - u * load(a, b + 16), s3 - u * load(a, b + 24)
        t0, t1 = t0 + v * load(a, b + 32), t1 + v * load(a, b + 40)
        t2, t3 = t2 + v * load(a, b + 48), t3 + v * load(a, b + 56)
    s0, s1, s2, s3 = s0 - t0, s1 - t1, s2 - t2, s3 - t3
    b = o + 32 * i
    v0 = s0 * load(a, b)
    v1 = (s1 - v0 * load(a, b + 8)) * load(a, b + 40)
    v2 = (s2 - v0 * load(a, b + 16) - v1 * load(a, b + 48)) * load(a, b + 80)
    v3 = (s3 - v0 * load(a, b + 24) - v1 * load(a, b + 56) - v2 * load(a, b + 88)) * load(a, b + 120)
    store(y, 8 * i, v0)
    store(y, 8 * i + 8, v1)
    store(y, 8 * i + 16, v2)
    store(y, 8 * i + 24, v3)


@njit(error_model="numpy", cache=True)
def substitute_back(a, y, n):
    """Solve `L' y = y` in place."""
    for i in range(n - 4, -1, -4):
        o = 16 * i * (i // 4 + 1)
        b = o + 32 * i
        v3 = load(y, 8 * i + 24) * load(a, b + 120)
        v2 = (load(y, 8 * i + 16) - v3 * load(a, b + 88)) * load(a, b + 80)
        v1 = (load(y, 8 * i + 8) - v3 * load(a, b + 56) - v2 * load(a, b + 48)) * load(a, b + 40)
        v0 = (load(y, 8 * i) - v3 * load(a, b + 24) - v2 * load(a, b + 16) - v1 * load(a, b + 8)) * load(a, b)
        store(y, 8 * i, v0)
        store(y, 8 * i + 8, v1)
        store(y, 8 * i + 16, v2)
        store(y, 8 * i + 24, v3)
        for p in range(i):
            b = o + 32 * p
            u = load(y, 8 * p) - v0 * load(a, b) - v1 * load(a, b + 8)
            store(y, 8 * p, u - v2 * load(a, b + 16) - v3 * load(a, b + 24))
