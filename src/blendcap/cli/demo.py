"""blendcap demo [--out DIR]."""

from __future__ import annotations

import json
import os
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import blendcap
from blendcap.cli.answers import print_lines
from blendcap.cli.progress import Progress
from blendcap.cli.solve import Outputs, bind_and_solve, summary, write_answers
from blendcap.cli.solve_inputs import Given

if TYPE_CHECKING:
    from blendcap.data import MarkerTake, Rig, Solution
    from blendcap.synthetic.takes import Truth

RATE, SECONDS = 60.0, 4.0
MARKERS = "markers50"  # the mannequin's own marker set


def demo(*, out: Path = Path("demo"), seed: int = 1) -> None:
    """Run the whole marker pipeline on the embedded mannequin.

    A performer whose face moves differently from the rig plays a range of motion and some speech; the markers are
    noisy, slip and are hidden at times. The rig is solved from them and the answer compared with the true motion.

    Parameters
    ----------
    out
        The folder to write to; made if it is not there, files of an earlier demo in it are replaced.
    seed
        Another seed is another performer, another speech and other noise.
    """
    from blendcap.io import write_markers, write_rig, write_whole

    if out.exists() and not out.is_dir():
        raise blendcap.InputError(f"Cannot write to {out}: it is a file; name a folder.")
    out.mkdir(parents=True, exist_ok=True)
    progress = Progress()
    with progress.step("mannequin", "Sculpt the mannequin"):
        rig = blendcap.mannequin(shapes=52)
        write_rig(out / "rig.glb", rig)
    with progress.step("capture", "Capture a performer who is not the rig"):
        rom, take, truth = _capture(rig, seed)
        write_markers(out / "rom.c3d", rom)
        write_markers(out / "take.c3d", take)
        places = {label: f"{MARKERS}/{label}" for label in take.names}
        with write_whole(out / "places.json") as path:
            path.write_text(json.dumps(places, indent=1), encoding="utf-8")
    settings = blendcap.SolveSettings(head="keep")  # the helmet takes the head's motion out
    binding, solution = bind_and_solve(Given(rig, take, places, rom), settings, progress)
    animations = (out / "animation.csv", out / "animation.glb")
    outputs = Outputs(animations, preview=out / "preview.mp4", report=out / "report.html")
    write_answers(rig, solution, binding, progress, outputs)
    facts = summary(take, solution, progress)
    print_lines(
        {key: facts[key] for key in ("frames", "rate", "markers", "rms_mm", "max_kkt")} | _errors(solution, truth, rig)
    )
    print(
        f"\nWatch {out / 'preview.mp4'}, read {out / 'report.html'}, open {out / 'animation.glb'} in Blender.\n"
        f"To solve it yourself:\n  {program()} solve {out / 'take.c3d'} --rig {out / 'rig.glb'} "
        f"--rom {out / 'rom.c3d'} --correspondences {out / 'places.json'} --head keep -o my.csv"
    )


def _capture(rig: Rig, seed: int) -> tuple[MarkerTake, MarkerTake, Truth]:
    """A range-of-motion take, a speech take and the truth of the speech."""
    from blendcap.synthetic.performances import range_of_motion, speech
    from blendcap.synthetic.performer import make_performer
    from blendcap.synthetic.takes import make_take

    performer = make_performer(rig, seed=seed)
    rom, worn = make_take(performer, range_of_motion(rig, RATE), rig.points[MARKERS], seed=seed)
    words = speech(rig, RATE, SECONDS, seed)
    take, truth = make_take(performer, words, worn.points, seed=seed + 1, misplacement=0.0)  # the markers stay glued on
    return rom, take, truth


def program() -> str:
    """How this program is called where it is not on the path, as in the environment that make sets up."""
    if shutil.which("blendcap"):
        return "blendcap"
    own = Path(sys.argv[0])
    return "python -m blendcap" if own.name == "__main__.py" else os.path.relpath(own)


def _errors(solution: Solution, truth: Truth, rig: Rig) -> dict[str, float]:
    """How far the answer is from the true face, and how far a face that never moves would be."""
    from dataclasses import replace

    def judge(animation):
        return blendcap.evaluate(animation, truth.animation, rig, truth_rig=truth.performer.rig)

    metrics, unmoved = judge(solution.animation), judge(replace(truth.animation, weights=0 * truth.animation.weights))
    return {
        "face error, mm": metrics.vertex_rmse_mm,
        "unmoved, mm": unmoved.vertex_rmse_mm,
        "blink gain": metrics.blink_gain,
    }
