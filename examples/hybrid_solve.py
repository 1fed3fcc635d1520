"""Markers and paint together: lids without markers, whose blinks the paint tells. Solved with and without.

python examples/hybrid_solve.py [FOLDER]
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import blendcap
from blendcap.makeup.lesson import Lesson
from blendcap.makeup.patches import extract_patches
from blendcap.makeup.setup import locate
from blendcap.synthetic.exercises import action_units
from blendcap.synthetic.head_camera import film_head, mount_head_camera
from blendcap.synthetic.makeup import draw_makeup
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.takes import choose_points, make_take
from blendcap.view import write_still

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
out.mkdir(parents=True, exist_ok=True)
RATE, SIZE = 12.0, (320, 240)
LIDS = ("eyeBlinkLeft", "eyeBlinkRight")

rig = blendcap.mannequin(1, shapes=52)
performer = make_performer(rig, seed=1)  # not the rig: her face moves in her own way
makeup = draw_makeup(performer.rig, seed=1)
whole = mount_head_camera(performer.rig, seed=1, size=SIZE)
helmet = replace(whole, names=whole.names[:2], cameras=whole.cameras[:2])  # the two that look at the eyes

points = choose_points(rig, 40)
_, deltas = rig.select(LIDS).sample(points)
markers = points.select(
    [name for name, blink in zip(points.names, deltas[0] + deltas[1], strict=True) if np.linalg.norm(blink) < 1]
)


def filmed(repeats: int, seed: int):
    """A take of blinks, its binding, its films, its patches, what was shown, and the truth."""
    shown = action_units(rig, ["45"], rate=RATE, repeats=repeats, seed=seed)
    take, truth = make_take(performer, shown.animation, markers, seed=seed)
    binding = blendcap.bind(rig, take, markers)
    setup = locate(rig, take, binding, helmet.cameras, [SIZE] * len(helmet.cameras))
    videos = [list(shot.frames()) for shot in film_head(truth, helmet, seed=seed, makeup=makeup)]
    eyes = {name: place for name, place in setup.places.items() if name.startswith("eye")}
    patches = extract_patches(videos, eyes, setup.anchors, RATE, dots=setup.dots, dot_radius=3)
    lead = len(take.positions) - len(shown.animation.weights)  # the neutral frames before
    spans = [((start + lead) / RATE, (stop + lead) / RATE, f"AU{unit}") for unit, start, stop, _ in shown.turns]
    return take, binding, videos, patches, Lesson.of_spans(spans, len(take.positions), RATE), truth


_, _, _, lesson_patches, lesson, _ = filmed(repeats=4, seed=1)
classifier = blendcap.train_classifier(lesson_patches, lesson)
print("left out while training:", {model.region.name: model.scores for model in classifier.models})

take, binding, videos, patches, _, truth = filmed(repeats=1, seed=2)
curves = blendcap.classify(classifier, patches)
print("trusted to", curves.confidence.mean(0).round(2), curves.names)
true = truth.animation.select(LIDS).weights
blink = int(true.sum(1).argmax())
alone, hybrid = (blendcap.solve(rig, take, binding, patches=told) for told in (None, curves))
tracks = blendcap.track_paint(videos, rig, take, binding, helmet.cameras, hybrid)
print(f"{len(tracks.rest)} points followed, {1 - tracks.lost.mean():.0%} of the time")
both = blendcap.solve(rig, take, binding, patches=curves, tracks=tracks)
for name, solution in (("markers only", alone), ("markers and patches", hybrid), ("and followed paint", both)):
    weights = solution.animation.weights
    write_still(out / f"{name.replace(' ', '_')}.png", rig, weights[blink], size=(450, 380), yaws=(0.0,))
    off = np.abs(solution.animation.select(LIDS).weights - true).mean()
    print(f"{name}: blinks off by {off:.3f}, marker error {solution.rms_mm:.2f} mm")
