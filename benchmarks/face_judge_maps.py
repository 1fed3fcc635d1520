"""Published maps from FaceMesh's vertices to the 68 landmarks, by the repository that uses them. None is official.

For each landmark, from the subject's right as iBUG counts, the vertices whose middle it is.
"""

from __future__ import annotations

import numpy as np

YAN = "PeizhiYan/Mediapipe_2_Dlib_Landmarks"
_BROWS = (70, 63, 105, 66, 107, 336, 296, 334, 293, 300)
_NOSE = (168, 197, 5, 4, 75, 97, 2, 326, 305)
_EYES = (33, 160, 158, 133, 153, 144, 362, 385, 387, 263, 373, 380)
_LIPS = (61, 39, 37, 0, 267, 269, 291, 321, 314, 17, 84, 91, 78, 82, 13, 312, 308, 317, 14, 87)


def _vertices(*parts: tuple[int, ...], **middles: tuple[int, int]) -> np.ndarray:
    """(68, 2): a vertex twice, or two; `middles` by n and the number of the landmark."""
    pairs = np.repeat(np.concatenate(parts)[:, None], 2, axis=1)
    for name, two in middles.items():
        pairs[int(name[1:])] = two
    return pairs


MAPS = {
    YAN: _vertices(
        (127, 234, 93, 132, 58, 136, 150, 176, 152, 400, 379, 365, 397, 361, 323, 454, 356), _BROWS, _NOSE, _EYES,
        _LIPS, n3=(132, 58), n4=(58, 172), n12=(397, 288), n27=(168, 6), n28=(197, 195),
    ),
    "yerfor/GeneFacePlusPlus": _vertices(
        (127, 234, 93, 132, 58, 136, 150, 176, 152, 400, 379, 365, 288, 361, 323, 454, 356), _BROWS, _NOSE, _EYES,
        (61, 40, 37, 0, 267, 270, 291, 321, 314, 17, 84, 91, 78, 81, 13, 311, 308, 402, 14, 178),
    ),
    "bytedance/LatentSync 1.5": _vertices(  # and in many others: it is the one that is copied most
        (162, 234, 93, 58, 172, 136, 149, 148, 152, 377, 378, 365, 397, 288, 323, 454, 389),
        (71, 63, 105, 66, 107, 336, 296, 334, 293, 301), _NOSE, _EYES,
        (61, 39, 37, 0, 267, 269, 291, 405, 314, 17, 84, 181, 78, 82, 13, 312, 308, 317, 14, 87),
    ),
    "cosanlab/py-feat": _vertices(  # its chin is landmark 10, and its nostrils are on the tip
        (127, 234, 93, 132, 58, 172, 136, 150, 176, 148, 152, 377, 400, 379, 365, 397, 356), _BROWS,
        (168, 6, 195, 4, 240, 75, 1, 305, 460), _EYES,
        (61, 39, 37, 0, 267, 269, 291, 405, 314, 17, 84, 181, 78, 82, 13, 312, 308, 317, 14, 87),
    ),
}  # fmt: skip


def as_68(points: np.ndarray, vertices: np.ndarray = MAPS[YAN]) -> np.ndarray:
    """The 68 landmarks (..., 68, 2) of FaceMesh's points (..., 478, 2), by a map (68, 2)."""
    return points[..., vertices, :].mean(-2)
