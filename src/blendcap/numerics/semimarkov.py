"""Posterior of a chain that moves in one of two modes, or by whole segments: forward and backward sweeps.

A hidden semi-Markov model (Yu 2010, doi:10.1016/j.artint.2009.11.011): the state is a level of a grid; from frame to
frame it moves as the mode of the step has it, or it runs through a segment of several frames and comes back to its
level. All sums are exact.
"""

from __future__ import annotations

import numpy as np
from numba import njit

FAR = 600.0  # nats: as good as impossible


def posterior_steps(
    costs: np.ndarray, segments: tuple[np.ndarray, np.ndarray], modes: np.ndarray, moves: np.ndarray, apart: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How probable it is that each step is not of the first mode, and what steps of the first are squared on average.

    Parameters
    ----------
    costs : (T, L)
        Minus the logarithm of how well each frame fits each level; any constant may be added to a frame's.
    segments : ((T, J, L), (J,) int)
        Minus the logarithm of how well the frames after each fit segment j from each level, its prior probability
        included, with the same constants, infinite where the segment would not end in time; frames of each segment.
    modes : (2, 2)
        Probability of the mode of a step, the second index, after the mode of the step before, the first.
    moves : (2, L, L)
        Probability of the next level given this one, of each mode.
    apart : (L, L)
        Square of the distance of two levels.

    Returns
    -------
    chance : (T,)
        Of the steps into each frame; that into the first is 0.
    squares : (T,)
        Of the step's square and its being of the first mode; its sum over that of `1 - chance` is a mean square.
    """
    least = costs.min(axis=1, keepdims=True)
    likelihood = np.exp(least - costs)
    costs_of, lengths = segments
    before = np.r_[0.0, np.cumsum(least)]
    ends = np.minimum(np.arange(len(costs))[:, None] + lengths + 1, len(costs))
    spent = before[ends] - before[1:, None]  # by the constants of the frames of a segment
    whole = np.exp(np.clip(spent[..., None] - costs_of, -FAR, FAR))
    alpha, scale = _forward(likelihood, whole, lengths, modes, moves)
    beta, after = _backward(likelihood, whole, lengths, modes, moves)
    return _chances(likelihood, whole, lengths, modes, moves, moves[0] * apart, alpha, scale, beta, after)


@njit(error_model="numpy", cache=True)
def _forward(likelihood, whole, lengths, modes, moves):
    """Probability of mode and level given the frames so far (T, 2, L), and the logarithm of these frames' (T,)."""
    frames, n = likelihood.shape
    alpha, scale = np.zeros((frames, 2, n)), np.zeros(frames)
    alpha[0, 0] = likelihood[0] / likelihood[0].sum()
    for t in range(1, frames):
        for s in range(2):
            alpha[t, s] = (_entering(alpha[t - 1], modes, s) @ moves[s]) * likelihood[t]
        for j in range(lengths.size):
            b = t - lengths[j]
            if b >= 0:
                alpha[t, 0] += alpha[b, 0] * whole[b, j] * np.exp(scale[b] - scale[t - 1])
        total = alpha[t].sum()
        alpha[t] /= total
        scale[t] = scale[t - 1] + np.log(total)
    return alpha, scale


@njit(error_model="numpy", cache=True)
def _backward(likelihood, whole, lengths, modes, moves):
    """How well the frames to come fit each mode and level, (T, 2, L) up to factors, whose logarithms are (T,)."""
    frames, n = likelihood.shape
    beta, scale = np.ones((frames, 2, n)), np.zeros(frames)
    for t in range(frames - 2, -1, -1):
        calm = moves[0] @ (beta[t + 1, 0] * likelihood[t + 1])
        quick = moves[1] @ (beta[t + 1, 1] * likelihood[t + 1])
        for s in range(2):
            beta[t, s] = modes[s, 0] * calm + modes[s, 1] * quick
        for j in range(lengths.size):
            e = t + lengths[j]
            if e < frames:
                beta[t, 0] += whole[t, j] * beta[e, 0] * np.exp(scale[e] - scale[t + 1])
        total = beta[t].sum()
        beta[t] /= total
        scale[t] = scale[t + 1] + np.log(total)
    return beta, scale


@njit(error_model="numpy", cache=True)
def _chances(likelihood, whole, lengths, modes, moves, squares, alpha, scale, beta, after):
    """Of both sweeps: what `posterior_steps` returns."""
    frames = len(likelihood)
    chance, square = np.zeros(frames), np.zeros(frames)
    evidence = np.log((alpha[0] * beta[0]).sum()) + scale[0] + after[0]
    for t in range(1, frames):
        factor = np.exp(scale[t - 1] + after[t] - evidence)
        calm, quick = beta[t, 0] * likelihood[t], beta[t, 1] * likelihood[t]
        square[t] = factor * (_entering(alpha[t - 1], modes, 0) @ (squares @ calm))
        chance[t] += factor * (_entering(alpha[t - 1], modes, 1) @ (moves[1] @ quick))
        for j in range(lengths.size):
            e = t - 1 + lengths[j]
            if e < frames:
                share = (alpha[t - 1, 0] * whole[t - 1, j] * beta[e, 0]).sum()
                chance[t : e + 1] += share * np.exp(scale[t - 1] + after[e] - evidence)
    return np.minimum(chance, 1.0), square


@njit(error_model="numpy", cache=True)
def _entering(alpha, modes, s):
    """Probability of a level and of a step of mode s from it."""
    return alpha[0] * modes[0, s] + alpha[1] * modes[1, s]
