"""How far one action differs from person to person, and how much of that is told by the face at rest.

    python benchmarks/identity_dependence.py [--people N] [--held-out M]

The mannequin's shapes come from each person's own muscles and proportions. Held-out people are guessed in three ways:
by the mean offset of the others (thesis 3.3.4, its baseline), by deformation transfer from the plain person (Eq. 18 to
25), and by ridge regression from the neutral's principal components to the offset. MakeHuman's expressions, sculpted
for three ethnicities by people and not by us, stand beside: there the neutral faces are not given, so only the mean of
the other two can be tried.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import numpy as np

import blendcap
from blendcap import Rig
from results import write_section

ACTIONS = {
    "smile": "mouthSmile*",
    "frown": "mouthFrown*",
    "open jaw": "jawOpen",
    "jaw aside": "jawLeft",
    "pucker": "mouthPucker",
    "funnel": "mouthFunnel",
    "mouth aside": "mouthLeft",
    "stretch": "mouthStretch*",
    "lips rolled in": "mouthRollLower mouthRollUpper",
    "upper lip up": "mouthUpperUp*",
    "lower lip down": "mouthLowerDown*",
    "chin raised": "mouthShrugLower",
    "cheeks puffed": "cheekPuff",
    "cheeks raised": "cheekSquint*",
    "nose wrinkled": "noseSneer*",
    "brows down": "browDown*",
    "brows up": "browInnerUp browOuterUp*",
    "blink": "eyeBlink*",
    "squint": "eyeSquint*",
    "wide eyes": "eyeWide*",
    "eyes squeezed": "eyeSqueeze*",
    "nostrils wide": "nostrilDilate*",
    "lips tightened": "mouthTightenUpper* mouthTightenLower*",
    "neck tightened": "neckTighten*",
}
INNER = ("eyes", "teeth", "tongue", "mouth", "sockets")
COMPONENTS = 12
RIDGES = np.geomspace(1e-3, 1e3, 25)
MOVES = 0.5  # mm in the plain person: vertices that an action is judged on


def names_of(action: str) -> tuple[str, ...]:
    words = ACTIONS[action].split()
    return tuple(w.replace("*", side) for w in words for side in (("Left", "Right") if "*" in w else ("",)))


def offsets(rig: Rig, action: str, vertices: np.ndarray) -> np.ndarray:
    rows = [rig.index(name) for name in names_of(action)]
    return rig.deltas[rows][:, vertices].sum(0).astype(np.float64)


def ridge(neutrals: np.ndarray, targets: np.ndarray, asked: np.ndarray) -> np.ndarray:
    """Targets (M, K) for neutrals asked (M, D), learnt from (P, D) and (P, K); the ridge by leaving one out."""
    middle = neutrals.mean(0)
    _, sizes, axes = np.linalg.svd(neutrals - middle, full_matrices=False)
    count = min(COMPONENTS, len(neutrals) - 2)
    axes, sizes = axes[:count], sizes[:count] / np.sqrt(len(neutrals))
    design, wanted = ((rows - middle) @ axes.T / sizes for rows in (neutrals, asked))
    mean, best = targets.mean(0), (np.inf, None)
    for penalty in RIDGES:
        solve = np.linalg.solve(design.T @ design + penalty * np.eye(len(axes)), design.T)
        hat = design @ solve
        left = (targets - mean - hat @ (targets - mean)) / (1 - np.diag(hat) - 1 / len(targets))[:, None]
        if (left**2).sum() < best[0]:
            best = (left**2).sum(), mean + wanted @ solve @ (targets - mean)
    return best[1]


def measure(people: int, held_out: int) -> tuple[list[str], np.ndarray]:
    """A row an action, and summed squares (A, 4): of the motion, and of what mean, transfer and ridge leave."""
    plain = blendcap.mannequin(0)
    skin = np.setdiff1d(plain.moving_vertices(), np.concatenate([plain.regions[n] for n in INNER]))
    judged = {a: skin[np.linalg.norm(offsets(plain, a, skin), axis=1) > MOVES] for a in ACTIONS}
    template = plain.select(dict.fromkeys(name for a in ACTIONS for name in names_of(a)))
    known, tested = ({"neutral": [], **{a: [] for a in ACTIONS}} for _ in range(2))
    carried = {a: [] for a in ACTIONS}
    for number in range(people + held_out):
        rig = blendcap.mannequin(number + 1)
        store = known if number < people else tested
        store["neutral"].append((rig.mesh.vertices - plain.mesh.vertices)[skin].ravel())
        for a in ACTIONS:
            store[a].append(offsets(rig, a, judged[a]))
        if store is tested:
            moved = blendcap.transfer_rig(template, rig.mesh)
            for a in ACTIONS:
                carried[a].append(offsets(moved, a, judged[a]))
    rows, sums = [], []
    for a in ACTIONS:
        learnt, true = np.array(known[a]), np.array(tested[a])
        regressed = ridge(np.array(known["neutral"]), learnt.reshape(people, -1), np.array(tested["neutral"]))
        guesses = 0, learnt.mean(0), np.array(carried[a]), regressed.reshape(true.shape)
        squares = np.array([((true - guess) ** 2).sum() for guess in guesses])
        sums.append(squares)
        lengths = " | ".join(f"{v:.3f}" for v in np.sqrt(3 * squares / true.size))
        rows.append(f"| {a} | {lengths} | {explained(squares[2], squares[1])} | {explained(squares[3], squares[1])} |")
    return rows, np.array(sums)


def explained(left: float, of: float) -> str:
    """The part of a sum of squares that is not left, in per cent; a dash where there was next to none."""
    return f"{100 * (1 - left / of):.1f} %" if of > 1e-6 else "-"


def makehuman(path: Path) -> str:
    """What the mean of two ethnicities tells of the third."""
    pack = np.load(path, allow_pickle=False)
    deltas = 100 * np.stack([pack[k] for k in ("deltas", "deltas_african", "deltas_asian")]).astype(np.float64)
    off = ((deltas - (deltas.sum(0) - deltas) / 2) ** 2).sum(3)
    moves = (np.linalg.norm(deltas, axis=3) > MOVES).any(0)
    size = (deltas**2).sum(3)[:, moves]
    each = [(float(np.sqrt(off[:, i, moves[i]].mean())), name) for i, name in enumerate(pack["names"])]
    worst = ", ".join(f"{name} {value:.2f} mm" for value, name in sorted(each, reverse=True)[:3])
    return (
        "MakeHuman, 34 expressions of three ethnicities: the mean offset of two explains "
        f"{explained(off[:, moves].sum(), size.sum())} of the motion of the third ({np.sqrt(size.mean()):.2f} mm root "
        f"mean square over what moves, {np.sqrt(off[:, moves].mean()):.2f} mm left); farthest off: {worst}."
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--people", type=int, default=48)
    parser.add_argument("--held-out", type=int, default=12)
    given = parser.parse_args()
    rows, each = measure(given.people, given.held_out)
    sums, least = each.sum(0), (each[:, 1] / each[:, 0]).argmax()
    head = f"""{given.held_out} mannequins guessed from {given.people} others, over the skin that the plain person moves
by more than {MOVES} mm. Root mean square, mm; what is explained is a part of what the mean offset leaves.

| action | motion | left by mean offset | by transfer | by ridge | transfer explains | ridge explains |
|---|---|---|---|---|---|---|"""
    tail = f"""
The mean offset explains {explained(sums[1], sums[0])} of the motion (least: {list(ACTIONS)[least]},
{explained(*each[least, 1::-1])}). Of the rest, which is what differs from person to
person, transfer from the plain person explains {explained(sums[2], sums[1])} (below 0: worse than the mean), ridge
regression on {COMPONENTS} components of the neutral {explained(sums[3], sums[1])}. These people come from one program
with thirty measures: regression has an easier time with them than with real ones."""
    data = Path(os.environ.get("BLENDCAP_DATA", "")) / "rigs" / "makehuman_face.npz"
    text = "\n".join([head, *rows, tail, *(["", makehuman(data)] if data.is_file() else [])])
    print(text)
    write_section("How far expressions depend on the person", "python benchmarks/identity_dependence.py", text)


if __name__ == "__main__":
    main()
