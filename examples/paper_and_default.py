"""The paper's solve and the default on the same take: what the learned prior wins, and what it costs in time."""

import time

import blendcap
from blendcap import SolveSettings
from blendcap.synthetic.performances import speech
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.takes import choose_points, make_take

rig = blendcap.mannequin(shapes=52)
performer = make_performer(rig, seed=5)
points = choose_points(rig, 50)
take, truth = make_take(performer, speech(rig, seconds=4.0, seed=5), points, seed=5)
binding = blendcap.bind(rig, take, points)

print(f"{'method':<10}{'face, mm':>10}{'roughness':>11}{'blink gain':>12}{'seconds':>9}")
errors = {}
for method in ("paper", "live", "learned"):
    start = time.perf_counter()
    solution = blendcap.solve(rig, take, binding, settings=SolveSettings(method=method))
    seconds = time.perf_counter() - start
    metrics = blendcap.evaluate(solution.animation, truth.animation, rig, truth_rig=performer.rig)
    errors[method] = metrics.vertex_rmse_mm
    numbers = (
        f"{metrics.vertex_rmse_mm:>10.3f}{metrics.roughness_ratio:>11.2f}{metrics.blink_gain:>12.2f}{seconds:>9.2f}"
    )
    print(f"{method:<10}{numbers}")
assert errors["learned"] < errors["paper"]
