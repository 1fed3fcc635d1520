"""blendcap doctor."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import blendcap

NEEDED = ("numpy", "scipy", "scikit-learn", "numba", "ezc3d", "trimesh", "libigl", "embreex",
          "opencv-python-headless", "imageio-ffmpeg", "matplotlib", "pillow", "cyclopts", "rich")  # fmt: skip
COMPILING = 64  # frames: enough for every kernel to be compiled
OPTIONAL = {"cvxopt": "fast", "daqp": "bench", "piqp": "bench", "pytest": "dev"}


def doctor() -> int:
    """Check this installation and say what to do if something is missing.

    The first time it also compiles the solvers and the renderer, which takes a minute; later runs load them.

    The exit code is 1 if something that is needed does not work; each such line says what to do.
    """
    ok = True
    for good, subject, finding in _findings():
        ok &= good is not False
        print(f"{'  ' if good is None else 'ok' if good else '!!'} {subject:<24}{finding}", flush=True)
    print("All is well." if ok else "Something is wrong: see the lines that begin with !!")
    return 0 if ok else 1


def _findings() -> Iterator[tuple[bool | None, str, str]]:
    """Each check as (works, what, finding); works is None where it is not needed."""
    yield True, "blendcap", f"{blendcap.__version__} in {Path(blendcap.__file__).parent}"
    yield True, "Python", f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    for package in NEEDED:
        version = _version(package)
        yield version is not None, package, version or "missing; run: pip install --upgrade blendcap"
    for package, extra in OPTIONAL.items():
        version = _version(package)
        yield (
            (True if version else None),
            package,
            version or f"not installed; pip install 'blendcap[{extra}]' brings it",
        )
    yield _threads()
    yield _cache()
    yield _video()
    yield _solver()
    yield _renderer()


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def _threads() -> tuple[bool, str, str]:
    import numba

    return True, "threads", f"{numba.config.NUMBA_NUM_THREADS} of {os.cpu_count()} cores"  # pyright: ignore


def _cache() -> tuple[bool | None, str, str]:
    """Compiled code is kept beside the package, or where NUMBA_CACHE_DIR says."""
    folder = Path(os.environ.get("NUMBA_CACHE_DIR") or Path(blendcap.__file__).parent)
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True, "compiled code", f"kept in {folder}"
    except OSError:
        return None, "compiled code", f"{folder} cannot be written to; set NUMBA_CACHE_DIR to a folder that can"


def _video() -> tuple[bool, str, str]:
    try:
        import imageio_ffmpeg

        return True, "video", f"ffmpeg {imageio_ffmpeg.get_ffmpeg_version()}"
    except (ImportError, RuntimeError) as error:
        return False, "video", f"no ffmpeg ({error}); run: pip install --upgrade imageio-ffmpeg"


def _solver() -> tuple[bool, str, str]:
    """Problems with a known answer: (a - 2)² is least at 1 within [0, 1], frame by frame and over all frames."""
    import numpy as np

    from blendcap.numerics.boxseq import solve_box_sequence

    start = time.perf_counter()
    try:
        gram, linear = np.eye(1), np.full((COMPILING, 1), -2.0)
        answers = (blendcap.solve_box(gram, linear), solve_box_sequence(gram, linear, np.ones(1)))
    except Exception as error:  # whatever a broken compiler or library raises is the finding
        return False, "solver", f"does not run ({type(error).__name__}: {error}); reinstall numba and numpy"
    good = all(certificate.converged and (weights == 1).all() for weights, certificate in answers)
    seconds = time.perf_counter() - start
    return good, "solver", f"exact, {seconds:.1f} s" if good else "gives a wrong answer; reinstall numba and numpy"


def _renderer() -> tuple[bool, str, str]:
    """A picture of the embedded face: it must hold more than its background."""
    from blendcap.rendering import face_camera, render

    start = time.perf_counter()
    try:
        mesh = blendcap.mannequin(shapes=52).mesh
        picture = render(mesh, face_camera(mesh.vertices, (64, 64)), (64, 64))
    except Exception as error:  # as for the solver
        return False, "renderer", f"does not run ({type(error).__name__}: {error}); reinstall numba and numpy"
    seconds = time.perf_counter() - start
    good = float(picture.std()) > 10
    return good, "renderer", f"draws, {seconds:.1f} s" if good else "draws nothing; reinstall numba and numpy"
