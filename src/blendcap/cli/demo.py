"""blendcap demo [--out DIR]."""

from __future__ import annotations

from pathlib import Path

import blendcap
from blendcap.cli.answers import print_lines
from blendcap.cli.progress import Progress
from blendcap.cli.solve import summary, write_answers

RATE, SECONDS, MARKERS = 60.0, 10.0, 50


def demo(*, out: Path = Path("demo"), seed: int = 1) -> None:
    """Run the whole marker pipeline on the embedded mannequin.

    A performer whose face moves differently from the rig plays a range of motion and some speech; the markers are noisy,
    slip and are hidden at times. The rig is solved from them and the answer compared with the true motion.

    Parameters
    ----------
    out
        The folder to write to; made if it is not there.
    seed
        Another seed is another performer, another speech and other noise.
    """
    from blendcap.io import write_markers, write_rig
    from blendcap.synthetic import choose_points, make_performer, make_take, range_of_motion, speech

    out.mkdir(parents=True, exist_ok=True)
    progress = Progress()
    with progress.step("Sculpt the mannequin"):
        rig = blendcap.mannequin()
        write_rig(out / "rig.glb", rig)
    with progress.step("Capture a performer who is not the rig"):
        performer = make_performer(rig, seed=seed)
        points = choose_points(rig, MARKERS)
        rom, _ = make_take(performer, range_of_motion(rig, RATE), points, seed=seed)
        take, truth = make_take(performer, speech(rig, RATE, SECONDS, seed), points, seed=seed + 1)
        write_markers(out / "rom.c3d", rom)
        write_markers(out / "take.c3d", take)
    with progress.step("Place the markers on the rig"):
        binding = blendcap.bind(rig, take, points, rom)
    with progress.step(f"Solve {len(take.positions):,} frames"):
        solution = blendcap.solve(rig, take, binding)
    outputs = (out / "animation.csv", out / "animation.glb")
    write_answers(rig, solution, binding, progress, outputs, preview=out / "preview.mp4", report=out / "report.html")
    with progress.step("Compare with the truth"):
        error = blendcap.evaluate(solution.animation, truth.animation, rig).vertex_rmse_mm
    facts = summary(take, solution, progress)
    print_lines({k: facts[k] for k in ("frames", "rate", "markers", "rms_mm", "max_kkt", "converged")}
                | {"vertex_rmse_mm": error})  # fmt: skip
    print(f"Next: watch {out / 'preview.mp4'}, read {out / 'report.html'}, open {out / 'animation.glb'} in Blender,")
    print(
        f"or do it by hand: blendcap solve {out / 'take.c3d'} --rig {out / 'rig.glb'} -o my.csv --rom {out / 'rom.c3d'}"
    )
