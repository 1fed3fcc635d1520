"""Noise on places in space, smooth or in spots. Whole numbers are hashed, so it is the same on every machine."""

from __future__ import annotations

import numpy as np
from numba import njit

Frequency = float | tuple[float, float, float]


def noise(places: np.ndarray, frequency: Frequency, seed: int) -> np.ndarray:
    """Smooth noise (P,) float32 about 0, deviation about 0.5, at places (P, 3); `frequency` in bumps a mm, by axis.

    Gradient noise (Perlin 1985, with the quintic fade of Perlin 2002).
    """
    return _noise(_float32(places), np.full(3, frequency, dtype=np.float32), seed)


def spots(places: np.ndarray, cell: float, radius: tuple[float, float], share: float, seed: int) -> np.ndarray:
    """Round spots (P,) float32, 1 in their middles: at most one in a cube of `cell` mm.

    A share of the cubes has one; radii lie between the two given, mm, the small ones being more frequent.
    """
    return _spots(_float32(places), np.float32(cell), np.float32(radius[0]), np.float32(radius[1]), share, seed)


def _float32(places: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(places, dtype=np.float32)


@njit(cache=True, forceinline=True)
def _hash(i, j, k, seed):
    """32 random bits of a cube of space (Wang's hash, mixed)."""
    h = (i * 73856093) ^ (j * 19349663) ^ (k * 83492791) ^ (seed * 2654435761)
    h &= 0xFFFFFFFF
    h = ((h ^ (h >> 16)) * 0x45D9F3B) & 0xFFFFFFFF
    h = ((h ^ (h >> 16)) * 0x45D9F3B) & 0xFFFFFFFF
    return h ^ (h >> 16)


@njit(cache=True, forceinline=True)
def _slope(bits, x, y, z):
    """The product of a place with one of twelve directions."""
    side = bits % 12
    first = 1.0 if bits & 16 else -1.0
    second = 1.0 if bits & 32 else -1.0
    if side < 4:
        return first * x + second * y
    return first * y + second * z if side < 8 else first * z + second * x


@njit(cache=True, forceinline=True)
def _fade(t):
    return t * t * t * (t * (t * 6 - 15) + 10)


@njit(cache=True, nogil=True)
def _noise(places, frequency, seed):
    values = np.empty(len(places), dtype=np.float32)
    for p in range(len(places)):
        x, y, z = places[p, 0] * frequency[0], places[p, 1] * frequency[1], places[p, 2] * frequency[2]
        fx, fy, fz = np.floor(x), np.floor(y), np.floor(z)
        i, j, k = int(fx), int(fy), int(fz)
        x, y, z = x - fx, y - fy, z - fz
        u, v, w = _fade(x), _fade(y), _fade(z)
        total = 0.0
        for c in range(8):
            a, b, d = c & 1, (c >> 1) & 1, c >> 2
            weight = (u if a else 1 - u) * (v if b else 1 - v) * (w if d else 1 - w)
            total += weight * _slope(_hash(i + a, j + b, k + d, seed), x - a, y - b, z - d)
        values[p] = 1.6 * total
    return values


@njit(cache=True, nogil=True)
def _spots(places, cell, least, most, share, seed):
    values = np.zeros(len(places), dtype=np.float32)
    limit = int(share * 65536)
    for p in range(len(places)):
        x, y, z = places[p, 0] / cell, places[p, 1] / cell, places[p, 2] / cell
        i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
        best = 0.0
        for c in range(27):
            a, b, d = i + c % 3 - 1, j + (c // 3) % 3 - 1, k + c // 9 - 1
            bits = _hash(a, b, d, seed)
            if (bits & 0xFFFF) >= limit:
                continue
            more = _hash(a, b, d, seed + 1)
            dx = x - a - (0.3 + 0.4 * (more & 255) / 255)
            dy = y - b - (0.3 + 0.4 * ((more >> 8) & 255) / 255)
            dz = z - d - (0.3 + 0.4 * ((more >> 16) & 255) / 255)
            size = (more >> 24) / 255
            radius = least + (most - least) * size * size * size
            near = 1 - cell * cell * (dx * dx + dy * dy + dz * dz) / (radius * radius)
            best = max(best, near)
        values[p] = best * (2 - best)
    return values
