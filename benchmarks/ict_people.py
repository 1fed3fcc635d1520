"""People of ICT-FaceKit whose eyes fit: identity modes move lids and eyeballs apart, until one pierces the other.

The modes are a statistical model of skin. Added as they are, lids sink up to 3 mm into the eyeballs and a blink leaves
2 mm open, which no living face does. Here the eyeballs are seated under the lids, the lids lie on them as the
template's do, and near the eyes the template's shapes are transferred, so that lids meet; elsewhere they are ICT's own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import blendcap
from blendcap import Rig
from blendcap.modeling.globes import find_globes
from blendcap.modeling.parts import pieces
from blendcap.numerics.easing import smoothstep
from blendcap.numerics.similarity import align, apply

LID = 5.5  # mm above an eyeball: skin that says how the eyeball is carried
LIES, FREE = 4.5, 14.0  # mm above it: skin below the first lies on it as the template's does, above the second is free
SOLID = ("teeth", "gums_and_tongue")  # near an eyeball by height, but not of the eye


def with_seated_eyes(template: Rig, vertices: np.ndarray) -> Rig:
    """The person whose neutral is `vertices` (V, 3), mm, with eyes that fit."""
    seated, near = vertices.copy(), np.zeros(len(vertices))
    rest, eyes = template.mesh.vertices, template.regions["eyes"]
    soft = np.ones(len(rest), dtype=bool)
    soft[np.concatenate([eyes, *(template.regions[name] for name in SOLID)])] = False
    for globe in find_globes(rest, pieces(template.mesh.faces, len(rest)), eyes):
        height = globe.height(rest)
        lids = soft & (height < LID)
        rotation, shift, scale = align(rest[lids], vertices[lids])
        shells = eyes[height[eyes] < LID]
        seated[shells] = apply(rest[shells], rotation, shift, scale)
        center = apply(globe.center[None], rotation, shift, scale)[0]
        share = np.where(soft, smoothstep(FREE, LIES, height), 0.0)
        away = np.linalg.norm(vertices - center, axis=1)
        rise = share * (scale * (height + globe.radius) - away) / away
        seated[soft] += (rise[:, None] * (vertices - center))[soft]
        near = np.maximum(near, smoothstep(FREE, LID, height))
    mesh = template.mesh.with_vertices(seated)
    met = blendcap.transfer_rig(template, mesh).deltas - template.deltas
    return replace(template, mesh=mesh, deltas=template.deltas + near[:, None].astype(np.float32) * met)
