"""blendcap rig refine TAKE -o RIG --rig RIG."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

import blendcap
from blendcap.cli.answers import AsJson, print_json, print_lines
from blendcap.cli.outputs import PICTURES, check_outputs
from blendcap.cli.progress import Progress
from blendcap.cli.rig_build import RIGS
from blendcap.cli.solve import Choices
from blendcap.cli.solve_inputs import Inputs

if TYPE_CHECKING:
    from blendcap.markers.personal import TakeRefinement

AS_USUAL = Choices()
NAMED = 6  # shapes that are named, those that changed most


def refine(
    take: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=("--output", "-o"))],
    inputs: Inputs,
    picture: Path | None = None,
    choices: Choices = AS_USUAL,
    as_json: AsJson = False,
) -> None:
    """Make a rig personal by a take of the same actor: what its markers and tracks do that no weights explain.

    Parameters
    ----------
    take
        The markers: .c3d, .trc or .csv, of the take that is to be solved; the longer and the livelier, the more it
        tells. Give --tracks, too: markers alone are too few to tell shapes by.
    output
        The refined rig: .glb or .npz, with the same shapes by the same names. Solve with it.
    picture
        A .png of the face colored by how far its shapes changed.
    as_json
        Print the answer as JSON.
    """
    from blendcap.io import write_rig
    from blendcap.view.heatmap import write_heatmap

    check_outputs([output], RIGS, [take, *inputs.files])
    check_outputs([picture], PICTURES)
    settings = choices.settings()
    progress = Progress(quiet=as_json)
    given = inputs.read(take, settings, progress)
    binding = given.bound(progress)
    with progress.step(
        "refine", f"Refine {len(given.rig.names)} shapes by {len(given.take.positions):,} frames"
    ) as tell:
        refined = blendcap.refine_from_take(
            given.rig, given.take, binding, settings=settings, progress=tell, **given.paint
        )
    with progress.step("write", f"Write {output}"):
        write_rig(output, replace(refined.rig, name=output.stem))
    if picture is not None:
        with progress.step("picture", f"Write {picture}"):
            heat = refined.change.max(0)
            title = f"Largest change of a shape at full weight, up to {heat.max():.1f} mm"
            write_heatmap(picture, given.rig, heat, title=title)
    files = [str(path) for path in (output, picture) if path is not None]
    facts = _facts(refined) | {"frames": len(given.take.positions), "seconds": progress.seconds}
    changes = dict(zip(refined.rig.names, refined.change.max(1).tolist(), strict=True))
    if as_json:
        print_json(facts | {"changes_mm": changes, "files": files})
    else:
        most = dict(sorted(changes.items(), key=lambda change: -change[1])[:NAMED])
        print_lines(facts | {"largest_changes_mm": most, "wrote": ", ".join(files)})


def _facts(refined: TakeRefinement) -> dict[str, Any]:
    certificate = refined.solution.certificate
    return {
        "coordinate_rms_mm_before": float(refined.rms[0]),
        "coordinate_rms_mm": float(refined.rms[-1]),
        "foretold": refined.foretold,
        "residual": refined.residual,
        "max_kkt": certificate.max_kkt,
        "converged": certificate.converged,
    }
