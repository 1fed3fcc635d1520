"""What a seed makes, in a few numbers: to hold one machine, one Python, one day against another.

python tests/fingerprints.py          prints them
python tests/fingerprints.py --write  and keeps them as what the test expects
"""

import json
import sys
from pathlib import Path

import numpy as np

from blendcap import Animation, Rig, mannequin
from blendcap.synthetic.conversation import conversation
from blendcap.synthetic.exercises import action_units, frown, lip_swing
from blendcap.synthetic.head_camera import film_head, mount_head_camera
from blendcap.synthetic.makeup import draw_makeup
from blendcap.synthetic.mislabels import mislabel
from blendcap.synthetic.performances import range_of_motion, speech
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.scans import make_scan
from blendcap.synthetic.takes import make_take
from blendcap.synthetic.views import one_camera

EXPECTED = Path(__file__).with_name("fingerprints.json")


def made(seed: int = 3) -> dict[str, np.ndarray]:
    """A mannequin, a performer, their performances, takes, strokes, films and a raw scan."""
    rig = mannequin(seed)
    performer = make_performer(rig, seed=seed)
    wave = np.sin(np.linspace(0, np.pi, 24))
    weights = np.zeros((24, len(rig.names)))
    weights[:, rig.index("jawOpen")], weights[:, rig.index("browInnerUp")] = wave, wave**2
    acted = Animation(weights, rig.names, 60.0)
    take, truth = make_take(performer, acted, rig.points["markers50"], seed=seed)
    strokes = draw_makeup(performer.rig, seed=5)
    shot = film_head(truth, mount_head_camera(performer.rig, seed=1), seed=7, makeup=strokes)
    scan = make_scan(performer, seed=seed)
    return {
        "vertices": rig.mesh.vertices, "deltas": rig.deltas, "texture": rig.mesh.texture,
        "performer": performer.rig.deltas, "markers": take.positions,
        "mistakes": mislabel(take, seed=seed, swaps=1, ghosts=1, loose=1)[0].positions,
        "makeup": np.concatenate([stroke.points for stroke in strokes]),
        "frame": next(shot[0].frames(12)), "film": next(one_camera(performer, acted, seed=seed).frames(12)),
        "scan": scan.mesh.vertices, "photograph": scan.mesh.texture, **_performances(rig, seed),
    }  # fmt: skip


def _performances(rig: Rig, seed: int) -> dict[str, np.ndarray]:
    played = {
        "range of motion": range_of_motion(rig), "speech": speech(rig, seconds=5.0, seed=seed),
        "conversation": conversation(rig, seconds=5.0, seed=seed),
        "action units": action_units(rig, seed=seed).animation, "lip swing": lip_swing(rig), "frown": frown(rig),
    }  # fmt: skip
    return {name: animation.weights for name, animation in played.items()}


def fingerprint(values: np.ndarray) -> list[float]:
    """How many numbers, how many are missing, and three sums weighed by waves of different lengths, per number."""
    flat = np.asarray(values, dtype=np.float64).ravel()
    missing, filled = np.isnan(flat), np.nan_to_num(flat)
    place = np.arange(len(flat), dtype=np.float64)
    sums = [float(np.mean(filled * (1 + np.sin(place * step)))) for step in (0.7, 0.011, 0.00013)]
    return [float(len(flat)), float(missing.sum()), *sums]


def main() -> None:
    found = {name: fingerprint(values) for name, values in made().items()}
    print(json.dumps(found, indent=1))
    if "--write" in sys.argv:
        EXPECTED.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
