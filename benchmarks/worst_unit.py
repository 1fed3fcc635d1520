"""The unit that the default tells worst (RESULTS.md, "Action units from makeup patches"): why, in a picture.

    python benchmarks/worst_unit.py OUT.png [--cache FOLDER]

ICT-FaceKit's person 121 and its teacher show the sideways pucker, 10+12+18+23 on the left, of which 10, 12 and 18 are
told each on its own.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from blendcap.makeup.curves import classify
from blendcap.makeup.training import train_classifier
from blendcap.view.style import BLUE, GREEN, INK, RED, new_figure, styled, write_plot
from hybrid_data import UNITS, exercise, lessons

UNIT, PARTS, PATCH = "AU10+12+18+23L", {"AU10L": RED, "AU12L": BLUE, "AU18": GREEN}, "mouth_left"
PEOPLE = {"teacher": 101, "person 121": 121}
AROUND = 12  # frames before and after a showing


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--cache", type=Path)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = chosen.cache or Path(temporary)
        classifier = train_classifier(*lessons("ICT", folder))
        shown = {name: _told(classifier, *exercise("ICT", person, folder)) for name, person in PEOPLE.items()}
    write_plot(chosen.out, plot(shown))


def _told(classifier, test, amounts: np.ndarray):
    """Seconds, true intensity and what is told of the parts around the strongest showing; its patch, and at rest."""
    units = {unit: {unit: 1.0} for unit in classifier.units}
    curves, true = classify(classifier, test.patches, table=units, full_blinks=False), amounts[:, UNITS.index(UNIT)]
    on = np.flatnonzero(true > 0.05)
    frames = np.arange(max(on[0] - AROUND, 0), min(on[-1] + AROUND, len(true)))
    parts = {unit: curves.weights[frames, curves.names.index(unit)] for unit in PARTS}
    pair = test.patches.neutral[PATCH], test.patches.images[PATCH][int(true.argmax())]
    return frames / curves.rate, true[frames], parts, np.hstack(pair)


@styled
def plot(shown):
    figure = new_figure(8.4, 4.2)
    grid = figure.subplots(2, len(shown), height_ratios=(1.0, 1.3), squeeze=False)
    for (name, (times, true, parts, pair)), (above, axes) in zip(shown.items(), grid.T, strict=True):
        above.imshow(pair, cmap="gray", vmin=0, vmax=255)
        above.axis("off")
        above.set_title(f"{name}: at rest, and at its strongest", fontsize=9)
        axes.plot(times, true, color=INK, label="played: 10+12+18+23 left")
        for unit, told in parts.items():
            axes.plot(times, told, color=PARTS[unit], linewidth=0.9, label=f"told: {unit.removeprefix('AU')}")
        axes.set_ylim(0, 1.05)
        axes.set_xlabel("seconds")
    grid[1, 0].legend(loc="upper left", fontsize=7)
    return figure


if __name__ == "__main__":
    main()
