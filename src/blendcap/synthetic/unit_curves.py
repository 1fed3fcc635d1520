"""What an animation shows in terms of the Facial Action Coding System."""

from __future__ import annotations

import numpy as np

from blendcap.data import Animation, InputError
from blendcap.data.facs import SHAPES
from blendcap.data.names import canonical


def unit_curves(animation: Animation) -> Animation:
    """The intensity of each action unit, 0 to 1, on each side: AU12L, AU12R, by rising number.

    A unit is as strong as the strongest of its shapes; a shape without a side counts for both. Shapes that the table of
    `blendcap.data.facs` does not know, or that stand for no unit, are left out.

    Raises
    ------
    InputError
        If no shape stands for an action unit.
    """
    table = {shape.name: shape for shape in SHAPES}
    columns: dict[tuple[int, str], list[int]] = {}
    for column, name in enumerate(animation.names):
        shape = table.get(canonical(name))
        for unit in shape.facs.split("+") if shape and shape.facs else ():
            for side in ("left", "right") if shape.side == "both" else (shape.side,):  # pyright: ignore
                columns.setdefault((int(unit), side), []).append(column)
    if not columns:
        raise InputError(f"None of the shapes {', '.join(animation.names[:4])} ... stands for an action unit.")
    keys = sorted(columns)
    weights = np.stack([animation.weights[:, columns[key]].max(1) for key in keys], axis=1)
    names = tuple(f"AU{unit}{side[0].upper()}" for unit, side in keys)
    return Animation(weights.clip(0, 1), names, animation.rate, times=animation.times)
