"""Which part of the face each vertex belongs to, told by the cage points that shape it."""

from __future__ import annotations

import numpy as np

from blendcap.synthetic.mannequin.cage import Cage
from blendcap.synthetic.mannequin.subdivision import Surface

_POINTS = {
    "forehead": "H2 H3 a0 b0 b2 b3 b4 P5 H4 c2 c0 c3",
    "glabella": "N0 G1 N1",
    "brows": "orbit.1 orbit.2 orbit.3 orbit.4 orbit.5",
    "lids": "margin.* edge.* crease.* sulcus.*",
    "nose": "N2 N3 N4 N4b N5 N6 C1 B1 S1 T1 W1 W2 W3 K1 K2 nostril.* vestibule.* orbit.0 orbit.11",
    "cheeks": "orbit.6 orbit.7 orbit.8 orbit.9 orbit.10 P6 P7 P8 P9 P10 Q5 Q6 Q7 Q8 Q9 Q10 R8 R9 R10 "
    "fold.3 fold.4 fold.5",
    "lips": "inner.* seam.* crest.* border.* around.* fold.0 fold.1 fold.2",
    "jaw": "fold.6 fold.7 fold.8 M67 M68 M77 M78 M87 M88 S10 S9 S8",
    "neck": "neck1.* neck2.* neck3.*",
    "ears": "root.* back.* helix.* scapha.* antihelix.* concha.*",
    "sockets": "sock.*",
    "mouth": "bag.* lining.* mi mc",
    "scalp": "c4 d0 d2 d3 d4 R5 R6 R7 S5 S6 S7 U0 U2 U3 U4 U5 U6 U7 V3 V4 V5 V6 V7",
}
_PULL = {"sockets": 8.0}  # what dives under the lids is no lid
UPPER = ("forehead", "glabella", "brows", "lids")
LOWER = ("nose", "cheeks", "lips", "jaw")


def skin_regions(cage: Cage, surface: Surface) -> dict[str, np.ndarray]:
    """Vertices of each region of the skin, and of the upper and the lower face; every vertex is in one region."""
    known = set(cage.names)
    share = np.zeros((len(_POINTS), cage.size))
    for row, (region, text) in enumerate(_POINTS.items()):
        words = text.split()
        names = [w for w in words if w in known] + [
            name for w in words if w.endswith(".*") for name in cage.names if name.startswith(w[:-1])
        ]
        left = cage.index(names)
        share[row, left] = share[row, cage.twin[left]] = _PULL.get(region, 1.0)
    owner = (surface.matrix @ share.T).argmax(1)
    regions = {name: np.flatnonzero(owner == row) for row, name in enumerate(_POINTS)}
    regions["upper"] = np.sort(np.concatenate([regions[name] for name in UPPER]))
    regions["lower"] = np.sort(np.concatenate([regions[name] for name in LOWER]))
    return regions
