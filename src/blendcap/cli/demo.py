"""blendcap demo [--out DIR]."""

from __future__ import annotations

from pathlib import Path

import blendcap
from blendcap.cli.answers import print_lines
from blendcap.cli.progress import Progress
from blendcap.cli.solve import bind_and_solve, summary, write_answers

RATE, SECONDS, MARKERS = 60.0, 8.0, 50


def demo(*, out: Path = Path("demo"), seed: int = 1) -> None:
    """Run the whole marker pipeline on the embedded mannequin.

    A performer whose face moves differently from the rig plays a range of motion and some speech; the markers are
    noisy, slip and are hidden at times. The rig is solved from them and the answer compared with the true motion.

    Parameters
    ----------
    out
        The folder to write to; made if it is not there.
    seed
        Another seed is another performer, another speech and other noise.
    """
    from blendcap.io import write_markers, write_rig

    out.mkdir(parents=True, exist_ok=True)
    progress = Progress()
    with progress.step("mannequin", "Sculpt the mannequin"):
        rig = blendcap.mannequin()
        write_rig(out / "rig.glb", rig)
    with progress.step("capture", "Capture a performer who is not the rig"):
        points, rom, take, truth = _capture(rig, seed)
        write_markers(out / "rom.c3d", rom)
        write_markers(out / "take.c3d", take)
    binding, solution = bind_and_solve(rig, take, points, rom, blendcap.SolveSettings(), progress)
    outputs = (out / "animation.csv", out / "animation.glb")
    write_answers(rig, solution, binding, progress, outputs, preview=out / "preview.mp4", report=out / "report.html")
    true_rig = truth.performer.rig
    metrics = blendcap.evaluate(solution.animation, truth.animation, rig, truth_rig=true_rig)
    facts = summary(take, solution, progress)
    print_lines(
        {key: facts[key] for key in ("frames", "rate", "markers", "rms_mm", "max_kkt", "converged")}
        | {"vertex_rmse_mm": metrics.vertex_rmse_mm, "blink_gain": metrics.blink_gain}
    )
    print(
        f"\nWatch {out / 'preview.mp4'}, read {out / 'report.html'}, open {out / 'animation.glb'} in Blender.\n"
        "To solve it yourself:\n"
        f"  blendcap solve {out / 'take.c3d'} --rig {out / 'rig.glb'} --rom {out / 'rom.c3d'} -o my.csv"
    )


def _capture(rig, seed: int):
    """Where the markers were meant to be, a range-of-motion take, a speech take and the truth of the speech."""
    from blendcap.synthetic.performances import range_of_motion, speech
    from blendcap.synthetic.performer import make_performer
    from blendcap.synthetic.takes import choose_points, make_take

    performer = make_performer(rig, seed=seed)
    points = choose_points(rig, MARKERS)
    rom, worn = make_take(performer, range_of_motion(rig, RATE), points, seed=seed)
    words = speech(rig, RATE, SECONDS, seed)
    take, truth = make_take(performer, words, worn.points, seed=seed + 1, misplacement=0)  # the markers stay glued on
    return points, rom, take, truth
