"""How well rigs are made: transfer with contact kept against plain transfer, and examples against transfer alone.

    python benchmarks/rigging.py [transfer|examples|examples140|speed]

Choices were made on the identities 1 to 6 (transfer) and 11 to 13 (examples); ten others report.
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from accuracy_data import DATA, FACE
from blendcap import Mesh, Rig, mannequin, solve_box
from blendcap.data.anatomy import inside_vertices
from blendcap.io.ict import read_ict_pack
from blendcap.modeling.contacts import find_contacts, gaps
from blendcap.modeling.examples import refine
from blendcap.modeling.transfer import transfer
from blendcap.synthetic.performer import make_performer
from results import write_section

PEOPLE = range(21, 31)
CLOSED = {"lids_left": ("eyeBlink_L",), "lids_right": ("eyeBlink_R",), "lips_jaw_open": ("jawOpen", "mouthClose")}
WEIGHT_NOISE, ROUGH, SMOOTH, REACH = 0.07, 0.05, 0.2, 40.0  # of the weights; mm, mm, mm
ALONE, PAPER = "transfer alone", "Eq. 27 to 29, weights given"
FIELDS, UNKNOWN = "**fields, weights given**", "fields, weights unknown"
WAYS = (ALONE, PAPER, FIELDS, UNKNOWN)


def ict_skin(seed: int | None = None) -> Rig:
    coefficients = None if seed is None else np.random.default_rng(seed).normal(size=100)
    rig = read_ict_pack(DATA / "rigs" / "ict_facekit.npz", coefficients)
    mesh = Mesh(rig.mesh.vertices[:FACE], rig.mesh.faces[(rig.mesh.faces < FACE).all(1)])
    return Rig(mesh, rig.deltas[:, :FACE], rig.names, mirror=rig.mirror, name="ICT")


def widest(rig: Rig, contacts) -> dict[str, np.ndarray]:
    """Gap (P,) of each pair in the pose that closes it, mm."""
    return {name: gaps(rig.mesh.vertices + sum(rig.deltas[rig.index(n)] for n in names), contacts[name])
            for name, names in CLOSED.items()}  # fmt: skip


def report_transfer() -> None:
    template = ict_skin()
    contacts = find_contacts(template)
    own = widest(template, contacts)
    lines = ["| identity | lids, plain | lids, kept | lips, plain | lips, kept | shape error, plain | kept | seconds |",
             "|---|---|---|---|---|---|---|---|"]  # fmt: skip
    for seed in PEOPLE:
        person, cells = ict_skin(seed), {}
        moved = np.linalg.norm(person.deltas, axis=2) > 0.1
        for method in ("paper", "contact"):
            begin = time.process_time()
            rig = transfer(template, person.mesh, method=method).rig
            seconds = time.process_time() - begin
            over = {name: (gap - own[name]).max() for name, gap in widest(rig, contacts).items()}
            error = np.linalg.norm(rig.deltas - person.deltas, axis=2)[moved].mean()
            cells[method] = (max(over["lids_left"], over["lids_right"]), over["lips_jaw_open"], error, seconds)
        plain, kept = cells["paper"], cells["contact"]
        lines.append(f"| {seed} | {plain[0]:+.2f} | {kept[0]:+.2f} | {plain[1]:+.2f} | {kept[1]:+.2f} "
                     f"| {plain[2]:.3f} | {kept[2]:.3f} | {kept[3]:.2f} |")  # fmt: skip
        print(lines[-1], flush=True)
    note = (
        "The 57 ICT shapes carried from the mean face to ten random identities (9,409 vertices). Gaps: the widest "
        "pair in the pose that closes it (eyeBlink; jawOpen with mouthClose) less the same in the template, mm. Shape "
        "error: mean distance to 'the same displacement on that identity' where a shape moves more than 0.1 mm, an "
        "approximate truth, mm. Seconds: processor time of the kept transfer on a busy machine."
    )
    write_section("Transfer of shapes", "python benchmarks/rigging.py transfer", f"{note}\n\n" + "\n".join(lines))


def poses(rig: Rig, rng: np.random.Generator, count: int, each: int) -> np.ndarray:
    """Weights (count, N): so many shapes a pose, both sides together, drivers added; every shape comes in turn."""
    groups = [sorted({i, int(rig.mirror[i])}) for i in range(len(rig.names)) if rig.mirror[i] >= i]
    order = np.concatenate([rng.permutation(len(groups)) for _ in range(1 + count * each // len(groups))])
    weights = np.zeros((count, len(rig.names)))
    for j in range(count):
        for i in (i for g in order[j * each : (j + 1) * each] for i in groups[g]):
            weights[j, i] = rng.uniform(0.5, 1)
    for name, drivers in rig.combinations.items():
        for driver in map(rig.index, drivers):
            weights[:, driver] = np.maximum(weights[:, driver], weights[:, rig.index(name)])
    return weights


def smooth_errors(vertices: np.ndarray, rng: np.random.Generator, count: int) -> np.ndarray:
    """What registration gets wrong (count, V, 3), mm: waves about `REACH` long."""
    waves = np.cos(vertices @ (rng.normal(size=(3, 20)) / REACH) + rng.uniform(0, 2 * np.pi, 20))
    errors = np.einsum("vk,jkc->jvc", waves, rng.normal(size=(count, 20, 3)))
    return SMOOTH * errors / np.sqrt((errors**2).sum(2).mean())


def judge(rig: Rig, true: Rig, weights, truth, skin) -> tuple[float, float, float]:
    """Errors, mm: of unseen expressions under their weights, under the best weights, and of the shapes."""

    def apart(vertices) -> float:
        return float(np.linalg.norm(vertices[:, skin] - truth[:, skin], axis=2).mean())

    flat = rig.deltas[:, skin].reshape(len(rig.names), -1).astype(np.float64)
    moved = (truth - rig.mesh.vertices)[:, skin].reshape(len(truth), -1)
    best, _ = solve_box(flat @ flat.T + 1e-5 * len(skin) * np.eye(len(flat)), -moved @ flat.T)
    true_deltas = true.deltas[: len(rig.names), skin]
    moves = np.linalg.norm(true_deltas, axis=2) > 0.5
    shape = np.linalg.norm(rig.deltas[:, skin] - true_deltas, axis=2)[moves].mean()
    return apart(rig.pose(weights)), apart(rig.pose(best)), float(shape)


def report_examples(shapes: int = 52) -> None:
    template = mannequin(shapes=shapes)
    tables = [table_of_examples(template, shapes, strength) for strength in (1.0, 0.0)]
    note = (
        f"Ten mannequin performers ({shapes} shapes that depend on the person); the rig is transferred from the plain "
        "mannequin to their neutral. At strength 1 they have personal gains and correctives besides: smooth fields, "
        "much like those that the default looks for, which is at home there. At strength 0 they have their own shapes "
        "and nothing else: what is to be learned is what transfer gets wrong. 20 examples of three shapes "
        f"(both sides) each, with {SMOOTH} mm of smooth and {ROUGH} mm of rough registration error; given weights are "
        f"off by {WEIGHT_NOISE}. 30 unseen expressions of four shapes. Mean distance over the moving skin, mm, and in "
        "brackets its ratio to transfer alone."
    )
    write_section("Examples that refine a rig", "python benchmarks/rigging.py examples", "\n\n".join([note, *tables]))


def report_all_shapes() -> None:
    """The whole rig: every shape is on in one example at least."""
    template = mannequin()
    write_all_shapes(table_of_examples(template, len(template.names), 1.0, 8, (ALONE, FIELDS)))


def write_all_shapes(table: str) -> None:
    note = (
        "As above at strength 1, with all 140 shapes and 20 examples of eight (both sides) each, so that each shape is "
        "on in one of them at least. With three shapes an example, which leaves 40 shapes unseen, one identity gained "
        "4 % only."
    )
    command = "python benchmarks/rigging.py examples140"
    write_section("Examples that refine all shapes", command, f"{note}\n\n{table}")


def refined_by(way: str, start: Rig, examples: list[Mesh], given: np.ndarray) -> Rig:
    if way == ALONE:
        return start
    if way == UNKNOWN:
        return refine(start, examples).rig
    return refine(start, examples, given, method="fields" if way == FIELDS else "paper").rig


def table_of_examples(template: Rig, shapes: int, strength: float, each: int = 3, ways: Sequence[str] = WAYS) -> str:
    lines = [f"Strength {strength:g}:", "", "| identity | | unseen, asked weights | unseen, best weights | shapes |",
             "|---|---|---|---|---|"]  # fmt: skip
    ratios: dict[str, list[np.ndarray]] = {}
    for seed in PEOPLE:
        rng = np.random.default_rng(seed)
        person = make_performer(mannequin(seed, shapes=shapes), seed=seed, strength=strength)
        start = transfer(template, person.rig.mesh).rig
        asked, unseen = poses(start, rng, 20, each), poses(start, rng, 30, 4) * rng.uniform(0.4, 1, (30, 1))
        scans = person.pose(asked) + smooth_errors(start.mesh.vertices, rng, 20)
        scans += ROUGH * rng.normal(size=scans.shape)
        examples = [start.mesh.with_vertices(scan) for scan in scans]
        given = np.clip(asked + WEIGHT_NOISE * rng.normal(size=asked.shape) * (asked > 0), 0, 1)
        skin = np.setdiff1d(start.moving_vertices(1.0), np.flatnonzero(inside_vertices(start)))
        truth, base = person.pose(unseen), np.zeros(3)
        for name in ways:
            rig = refined_by(name, start, examples, given)
            errors = np.array(judge(rig, person.rig, unseen, truth, skin))
            base = errors if rig is start else base
            ratios.setdefault(name, []).append(errors / base)
            cells = " | ".join(f"{e:.3f} ({r:.2f})" for e, r in zip(errors, errors / base, strict=True))
            lines.append(f"| {seed} | {name} | {cells} |")
            print(lines[-1], flush=True)
    for name, rows in ratios.items():
        mean, worst = np.mean(rows, axis=0), np.max(rows, axis=0)
        lines.append(f"| all | {name}: mean (worst) ratio | "
                     + " | ".join(f"{m:.2f} ({w:.2f})" for m, w in zip(mean, worst, strict=True)) + " |")  # fmt: skip
    return "\n".join(lines)


def report_speed() -> None:
    """140 shapes, 20 examples, 9,409 vertices: the ICT shapes, and mixtures of them."""
    rig, rng = ict_skin(), np.random.default_rng(0)
    mixed = np.concatenate(
        [rig.deltas, np.tensordot(rng.dirichlet(np.ones(57) / 8, 83).astype(np.float32), rig.deltas, 1)]
    )
    large = replace(rig, deltas=mixed, names=tuple(map(str, range(140))), mirror=np.arange(140),
                    bounds=np.tile([0.0, 1.0], (140, 1)))  # fmt: skip
    weights = rng.uniform(0, 1, (20, 140)) * (rng.random((20, 140)) < 0.05)
    examples = [large.mesh.with_vertices(v + rng.normal(scale=0.2, size=v.shape)) for v in large.pose(weights)]
    lines = [
        "| method | processor seconds | largest optimality residual of the weights | peak memory, GB |",
        "|---|---|---|---|",
    ]
    for method in ("fields", "paper"):
        begin = time.process_time()
        made = refine(large, examples, weights, method=method)
        seconds = time.process_time() - begin
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
        lines.append(f"| {method} | {seconds:.1f} | {made.max_kkt:.0e} | {peak:.2f} |")
        print(lines[-1], flush=True)
    note = "140 shapes, 20 examples, 9,409 vertices; the peak is that of the process so far, on a busy machine."
    write_section("Speed of refining a rig", "python benchmarks/rigging.py speed", f"{note}\n\n" + "\n".join(lines))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", nargs="?", choices=("transfer", "examples", "examples140", "speed"))
    kind = parser.parse_args().kind
    reports = {"transfer": report_transfer, "examples": report_examples, "examples140": report_all_shapes,
               "speed": report_speed}  # fmt: skip
    for name, report in reports.items():
        if kind in (None, name):
            report()


if __name__ == "__main__":
    main()
