"""From markers to an animated face, in Python: a performer with known truth, the binding, the solve, the errors."""

import sys
from pathlib import Path

import blendcap
from blendcap.synthetic.performances import range_of_motion, speech
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.takes import choose_points, make_take

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
out.mkdir(parents=True, exist_ok=True)

# The performer is not the rig: each shape moves this face a little differently, and some shapes correct each other.
rig = blendcap.mannequin(shapes=52)
performer = make_performer(rig, seed=3)

# 50 markers, 0.2 mm noise, glued 1.5 mm beside their places, on a helmet that slips; 5 % of the samples are hidden.
points = choose_points(rig, 50)
rom, worn = make_take(performer, range_of_motion(rig), points, seed=3)
take, truth = make_take(performer, speech(rig, seconds=4.0, seed=3), worn.points, seed=4, misplacement=0.0)

binding = blendcap.bind(rig, take, points, rom)
solution = blendcap.solve(rig, take, binding)
blendcap.write_rig(out / "performance.glb", rig, solution.animation)

metrics = blendcap.evaluate(solution.animation, truth.animation, rig, truth_rig=performer.rig)
still = blendcap.Animation(0 * truth.animation.weights, truth.animation.names, take.rate)
baseline = blendcap.evaluate(still, truth.animation, rig, truth_rig=performer.rig)
print(f"markers are matched to {(solution.rms**2).mean() ** 0.5:.2f} mm")
print(
    f"the face is off by {metrics.vertex_rmse_mm:.2f} mm, a face that never moves by {baseline.vertex_rmse_mm:.2f} mm"
)
for region, error in sorted(metrics.by_region_mm.items(), key=lambda item: -item[1]):
    print(f"  {region:<12}{error:.2f} mm, unmoved {baseline.by_region_mm[region]:.2f} mm")
assert solution.certificate.converged and metrics.vertex_rmse_mm < baseline.vertex_rmse_mm
