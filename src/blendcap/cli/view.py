"""blendcap view RIG [ANIM]."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

import blendcap
from blendcap.cli.films import thin_film, writes
from blendcap.cli.outputs import PICTURES, VIDEOS, check_outputs
from blendcap.cli.progress import Progress

if TYPE_CHECKING:
    from blendcap.data import Animation, Rig
    from blendcap.io.video import Video

FACE_SIZE = (486, 540)  # beside a film


def view(
    rig: Path,
    animation: Path | None = None,
    /,
    *,
    output: Annotated[Path | None, Parameter(name=("--output", "-o"))] = None,
    video: Path | None = None,
    offset: float = 0.0,
    frame: int | None = None,
) -> None:
    """Look at a rig, or at an animation on it: a picture or a film.

    Parameters
    ----------
    rig
        The rig: .glb, .npz, a folder of .obj.
    animation
        Weights over time. Other spellings of the rig's shapes are matched; shapes that it lacks are left out.
    output
        .png: all shapes of the rig, or one frame of the animation. .mp4 or .gif: the animation in real time; above 30
        frames a second some are left out. If not given, a new file in the folder where you are, named after the
        animation or the rig.
    video
        A film of the performance, shown beside the animated face.
    offset
        When the animation begins in that film, seconds.
    frame
        The frame to show as .png; the one that is farthest from neutral if not given.
    """
    target = output or Path((animation or rig).stem + (".png" if animation is None or frame is not None else ".mp4"))
    check_outputs([target], PICTURES + (VIDEOS if animation is not None else ()), [video])
    _check_use(target, animation, video, offset, frame)
    if output is None and target.exists():  # a name that nobody gave must not cost a file
        raise blendcap.InputError(f"{target} is there already; name the file to write, with -o {target} to replace it.")
    progress = Progress()
    with progress.step("read", "Read the files"):
        the_rig = blendcap.read_rig(rig)
        curves = None if animation is None else _on_rig(blendcap.read_animation(animation), the_rig)
        film = None if video is None else blendcap.read_video(video)
    shown = ""
    if curves is None:
        from blendcap.view import write_contact_sheet

        with progress.step("picture", f"Write {target}"):
            write_contact_sheet(target, the_rig)
    elif target.suffix.lower() in PICTURES:
        with progress.step("picture", f"Write {target}"):
            shown = _write_frame(target, the_rig, curves, frame)
    else:
        _write_film(target, the_rig, curves, film, offset, progress)
    print(f"Open {target}{shown}.")


def _check_use(target: Path, animation: Path | None, video: Path | None, offset: float, frame: int | None) -> None:
    """Refuse what does not go together."""
    picture = target.suffix.lower() in PICTURES
    if frame is not None and (animation is None or not picture):
        raise blendcap.InputError("--frame picks a frame of an animation for a .png; give both, or leave it out.")
    if offset and video is None:
        raise blendcap.InputError("--offset says when the animation begins in a film; give --video, or leave it out.")
    if video is not None and (animation is None or picture):
        raise blendcap.InputError("--video is shown beside an animation in a film; give an animation and -o FILE.mp4.")


def _on_rig(animation: Animation, rig: Rig) -> Animation:
    from blendcap.data.names import in_vocabulary

    return in_vocabulary(animation, rig.names)


def _write_frame(path: Path, rig: Rig, animation: Animation, frame: int | None) -> str:
    """Write one frame of an animation; returns which it is, in words."""
    from blendcap.view import write_still
    from blendcap.view.posing import warn_of_unknown, weights_on

    weights = weights_on(rig, animation)
    last = len(weights) - 1
    if frame is not None and not 0 <= frame <= last:
        raise blendcap.InputError(f"There is no frame {frame}; the animation has the frames 0 to {last}.")
    chosen = int((weights**2).sum(1).argmax()) if frame is None else frame
    warn_of_unknown(animation, [chosen])
    write_still(path, rig, weights[chosen])
    why = ", the farthest from neutral" if frame is None else ""
    return f": frame {chosen} of 0 to {last}, {animation.times[chosen]:.2f} s{why}"


def _write_film(
    path: Path, rig: Rig, animation: Animation, video: Video | None, offset: float, progress: Progress
) -> None:
    """The animation by itself, or beside the film of the performance."""
    from blendcap.view import write_beside_film, write_preview

    film = thin_film(animation, rig.name)
    with progress.step("film", writes(path, film, animation), total=film.count(animation)) as tell:
        if video is None:
            write_preview(path, rig, animation, film, progress=tell)
        else:
            face = replace(film, size=FACE_SIZE, yaws=(0.0,), title="")
            write_beside_film(path, rig, animation, video, face, offset=offset, progress=tell)
