"""When a quick shape, as an eyelid, is calm and when it moves, told from all frames at once.

A lid that few markers see is known to a fifth of a weight in one frame. If its steps were judged one by one, either its
blinks would be smoothed away or it would flutter between them. A hidden semi-Markov model of one lid after the other
weighs what the frames say together: a lid drifts, or is on its way by large steps, or it blinks, whereafter it is back
where it was.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from blendcap.data import InputError
from blendcap.numerics.easing import smoothstep
from blendcap.numerics.semimarkov import posterior_steps
from blendcap.solving.curves import Curves
from blendcap.solving.prior import PSEUDO_FRAMES, step_variance
from blendcap.solving.rows import MarkerRows

# Standard deviations of steps at 60 frames a second. Those of `calm` are learned; this is what it begins with.
CALM, MOVING = 0.005, 0.15
FREE = 0.15  # of a step that is known to be part of an event, beside what the steps around it foretell
# Probabilities at 60 frames a second; generous, since a false alarm costs a restless moment and a miss costs a blink.
BLINKS, BEGINS = 0.02, 0.01
STAYS = 0.75  # that a step on the way is followed by another
SHUT = 0.8  # a lid that is farther down than this is shut
DEPTHS = (0.4, 0.7, 1.0)  # how far blinks go of the way to shut
TIMES = ((0.07, 0.13), (0.13, 0.27))  # seconds in which they close and open
LEVELS = np.linspace(0, 1, 25)
BLIND = (LEVELS[1] - LEVELS[0]) / 2  # what the grid cannot tell is as good as noise
FASTEST = 60.0  # frames a second that the model looks at; what is between says nothing more
ROUNDS = 3
LOST = 0.1  # of what frames usually tell of a lid: one that tells less may have lost its markers


def told_by_frames(
    rows: MarkerRows, unknowns: np.ndarray, noise: float, curves: Curves | None, strength: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray]:
    """What each frame on its own says of each weight, all others staying where they are, and the precision of that.

    Parameters
    ----------
    rows : MarkerRows
    unknowns : (T, N + K)
        Of an answer.
    noise : float
        Of one coordinate, mm.
    curves : Curves or None
        What else is known of the weights, with a `strength` in mm², one number or one a shape (N,).

    Returns
    -------
    told, precision : (T, N)
        The precision is one over variance; where it is 0, the answer stands in for what is told.
    """
    columns, weights = rows.rows[:, :, : rows.shapes], unknowns[:, : rows.shapes]
    left = np.where(rows.missing[..., None], 0.0, rows.targets - rows.predict(unknowns))
    energy = ~rows.missing @ (columns**2).sum(1)
    pull = left.reshape(len(left), -1) @ columns.reshape(-1, rows.shapes)
    if curves is not None:
        energy = energy + strength * curves.confidence
        pull = pull + strength * curves.confidence * (curves.targets - weights)
    told = weights + np.divide(pull, energy, out=np.zeros_like(pull), where=energy > 1e-12)
    return told, energy / noise**2


def lid_events(
    told: np.ndarray, precision: np.ndarray, quick: np.ndarray, partner: np.ndarray, rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """How probable it is that each step of a quick shape is part of an event, and the variance of its other steps.

    Lids blink together, which tells more than each does, but one may wink: an event of either view is one.

    Parameters
    ----------
    told, precision : (T, N)
        From `told_by_frames`. A lid that is shut has the weight 1.
    quick : (N,) bool
    partner : (N,) int
        The shape on the other side that goes with each; itself if none does.
    rate : float
        Frames a second.

    Returns
    -------
    chance : (T, N)
        0 for shapes that are not quick.
    calm : (N,)
        NaN for shapes that are not quick.
    """
    chance, calm = np.zeros_like(told), np.full(told.shape[1], np.nan)
    for i in np.flatnonzero(quick):
        pair = [i] if partner[i] == i else [i, partner[i]]
        chance[:, i], calm[i] = step_chances(*_pooled(told[:, pair], precision[:, pair]), rate)
        if len(pair) > 1:
            chance[:, i] = np.maximum(chance[:, i], step_chances(told[:, i], precision[:, i], rate)[0])
    return chance, calm


def hidden(precision: np.ndarray, guess: float, quick: np.ndarray, partner: np.ndarray) -> np.ndarray:
    """(T, N) bool: frames that tell less of a quick shape and its partner than a guess does, though others do.

    What other markers hint at then, a brow that the rig does not follow, is no blink.

    Parameters
    ----------
    precision, quick, partner
        As in `lid_events`.
    guess : float
        Standard deviation of a weight before a frame is seen.
    """
    both = precision + np.where(partner != np.arange(len(partner)), precision[:, partner], 0.0)
    return quick & (both < guess**-2) & (both < LOST * np.median(both, axis=0))


def _pooled(told: np.ndarray, precision: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What two sides (T, 2) tell together, and its precision, (T,).

    One lid may hang lower than the other: each side's mean is set aside, or where one is hidden the level would leap.
    """
    usual = (precision * told).sum(0) / np.maximum(precision.sum(0), 1e-12)
    both = precision.sum(1)
    apart = (precision * (told - usual)).sum(1) / np.maximum(both, 1e-12)
    return apart + (precision.sum(0) * usual).sum() / max(float(both.sum()), 1e-12), both


def step_chances(told: np.ndarray, precision: np.ndarray, rate: float) -> tuple[np.ndarray, float]:
    """Probability (T,) that the step into a frame is part of an event, and the variance of a step that is not.

    Parameters
    ----------
    told, precision : (T,)
        What each frame says of the weight, and one over its variance, 0 where it says nothing.
    rate : float
        Frames a second.

    Raises
    ------
    InputError
        If one of them is not a number, or a precision is below 0.
    """
    if not (np.isfinite(told).all() and np.isfinite(precision).all() and (precision >= 0).all()):
        raise InputError(
            "What frames tell of a weight must be numbers, of a precision of 0 or more; 0 where they tell nothing."
        )
    block = max(round(rate / FASTEST), 1)
    firsts = np.arange(0, len(told), block)
    total = np.add.reduceat(precision, firsts)
    mean = np.add.reduceat(precision * told, firsts) / np.maximum(total, 1e-12)
    chance, calm = _chances(mean, total, rate / block)
    middle = np.minimum((np.arange(len(told)) + block // 2) // block, len(chance) - 1)  # of two blocks lies a step
    return chance[middle], calm / block


def _chances(told: np.ndarray, precision: np.ndarray, rate: float) -> tuple[np.ndarray, float]:
    scale = 60 / rate
    start = calm = step_variance(CALM, rate)
    precision = precision / (1 + precision * BLIND**2)
    costs = 0.5 * precision[:, None] * (told[:, None] - LEVELS) ** 2
    blinks = _blink_costs(told, precision, rate)
    begins, blink = BEGINS * scale, BLINKS * scale
    stays = STAYS**scale
    modes = np.array([[max(1 - begins - blink, 0.1), begins], [1 - stays, stays]])
    apart, moving = (LEVELS[:, None] - LEVELS) ** 2, _diffusion(step_variance(MOVING, rate))
    chance = np.zeros(len(told))
    for _ in range(ROUNDS):
        chance, squares = posterior_steps(costs, blinks, modes, np.stack([_diffusion(calm), moving]), apart)
        calm = (squares.sum() + PSEUDO_FRAMES * start) / ((1 - chance[1:]).sum() + PSEUDO_FRAMES)
    return chance, calm


def _diffusion(variance: float) -> np.ndarray:
    """(L, L) probability of the next level given this one: a random walk that stays between the bounds.

    The heat kernel of the grid has the right variance even where a step is far smaller than the grid is wide.
    """
    count, width = len(LEVELS), LEVELS[1] - LEVELS[0]
    walk = np.eye(count, k=1) + np.eye(count, k=-1)
    return expm(variance / (2 * width**2) * (walk - np.diag(walk.sum(1))))


def _blink_costs(told: np.ndarray, precision: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Costs (T, J, L) of each kind of blink after each frame from each level, and how many frames it takes (J,)."""
    shapes = [depth * _blink(*times, rate) for times in TIMES for depth in DEPTHS]
    lengths, frames = np.array([len(shape) for shape in shapes]), len(told)
    costs = np.full((frames, len(shapes), len(LEVELS)), np.inf)
    for j, shape in enumerate(shapes):
        starts = np.arange(max(frames - len(shape), 0))
        costs[starts, j] = -np.log(BLINKS * 60 / rate / len(shapes))
        for k, way in enumerate(shape, 1):
            value = LEVELS + (1 - LEVELS) * way
            costs[starts, j] += 0.5 * precision[starts + k, None] * (told[starts + k, None] - value) ** 2
    costs[:, :, LEVELS > SHUT] = np.inf  # it does not blink
    return costs, lengths


def _blink(closing: float, opening: float, rate: float) -> np.ndarray:
    """(K,) how far shut a lid is, frame by frame, from the first that sees it move to the first that sees it back."""
    close, open_ = (max(round(seconds * rate), 1) for seconds in (closing, opening))
    way = np.r_[np.arange(1, close + 1) / close, 1 - np.arange(1, open_ + 1) / open_]
    return smoothstep(0, 1, way)
