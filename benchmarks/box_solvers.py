"""The exact solvers against DAQP and PIQP: one core, one process, interleaved rounds.

OPENBLAS_NUM_THREADS=1 python benchmarks/box_solvers.py [rounds]
"""

from __future__ import annotations

import os

for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_variable] = "1"

import platform
import subprocess
import sys
import tempfile
import time
from importlib.metadata import version
from pathlib import Path

import daqp
import numpy as np
import piqp
from scipy import sparse

from blendcap.numerics.boxls import solve_box
from blendcap.numerics.boxseq import solve_box_sequence
from ict_problem import ict_problem
from results import write_section

PEER_FRAMES = {53: 800, 140: 100}  # the slow ones answer the first frames only
COUPLING, SEQUENCE_FRAMES = 20.0, {53: 300, 140: 60}

SPARSE = "PIQP sparse_multistage (column KKT: distance to our weights)"
TARGETS = {  # times as many frames a second as the peer
    ("N = 53 + 12", "DAQP update"): 7,
    ("N = 53 + 12", "PIQP update"): 60,
    ("N = 140 + 12", "DAQP update"): 28,
    ("N = 140 + 12", "PIQP update"): 60,
    ("N = 53 + 12, diagonal", "DAQP update"): 20,
    ("N = 140 + 12, diagonal", "DAQP update"): 60,
    (f"N = 53 + 12, sequence, c = {COUPLING:g}", SPARSE): 8,
    (f"N = 140 + 12, sequence, c = {COUPLING:g}", SPARSE): 25,
}
LEAST = 0.25  # seconds of a timed run
TARGET_SECONDS = 2.0  # of the long take


def seconds(run):
    """Processor time of one run, of as many in a row as take `LEAST` seconds: caches are warm for all alike."""
    runs, begin = 0, time.process_time()
    while True:
        answer = run()
        runs += 1
        spent = time.process_time() - begin
        if spent >= LEAST:
            return spent / runs, answer


def residual(gram, linear, weights, diagonal=0.0):
    step = weights - (weights @ gram + linear + diagonal * weights) / (np.diag(gram) + diagonal)
    return float(np.abs(weights - np.clip(step, 0, 1)).max())


def run_daqp(gram, linear, frames, diagonal=None):
    n = len(gram)
    model, none = daqp.Model(), np.zeros((0, n))
    model.setup(gram, linear[0], none, np.ones(n), np.zeros(n), np.zeros(n, np.int32))
    answers = np.empty((frames, n))
    for t in range(frames):
        if diagonal is None:
            model.update(f=linear[t])
        else:
            model.update(H=gram + np.diag(diagonal[t]), f=linear[t])
        answers[t] = model.solve()[0]
    return answers


def run_piqp(gram, linear, frames, diagonal=None):
    n = len(gram)
    solver = piqp.DenseSolver()
    solver.settings.eps_abs = solver.settings.eps_rel = 1e-9
    solver.setup(gram, linear[0], x_l=np.zeros(n), x_u=np.ones(n))
    answers = np.empty((frames, n))
    for t in range(frames):
        if diagonal is None:
            solver.update(c=linear[t])
        else:
            solver.update(P=gram + np.diag(diagonal[t]), c=linear[t])
        solver.solve()
        answers[t] = solver.result.x
    return answers


def run_piqp_sequence(gram, linear, coupling):
    frames, n = linear.shape
    difference = sparse.diags([-1.0, 1.0], [0, 1], shape=(frames - 1, frames))
    whole = sparse.kron(sparse.eye(frames), gram) + coupling * sparse.kron(difference.T @ difference, sparse.eye(n))
    solver = piqp.SparseSolver()
    solver.settings.eps_abs = solver.settings.eps_rel = 1e-9
    solver.settings.kkt_solver = piqp.KKTSolver.sparse_multistage
    size = frames * n
    solver.setup(sparse.csc_matrix(whole), linear.ravel(), x_l=np.zeros(size), x_u=np.ones(size))
    solver.solve()
    return solver.result.x.reshape(frames, n)


def compare(label, runs, rounds):
    """Rows of the table: our frames a second, and the ratio to each peer with its spread over the rounds."""
    rates = {name: [] for name, _, _ in runs}
    kkt = {}
    for _ in range(rounds):
        for name, frames, run in runs:
            spent, kkt[name] = seconds(run)
            rates[name].append(frames / spent)
    ours = np.array(rates.pop("blendcap"))
    rows = []
    for name, theirs in rates.items():
        ratio = ours / np.array(theirs)
        spread = f"{np.median(ratio):.1f}x ({ratio.min():.1f}..{ratio.max():.1f})"
        target = TARGETS.get((label, name))
        verdict = "" if target is None else f"{target}x: {'met' if np.median(ratio) >= target else 'missed'}"
        speed = f"{np.median(ours):,.0f} | {np.median(theirs):,.0f}"
        rows.append(f"| {label} | {name} | {speed} | {spread} | {verdict} | {kkt['blendcap']:.0e} | {kkt[name]:.0e} |")
        print(rows[-1], flush=True)
    return rows


def frame_rows(shapes, rounds):
    p = ict_problem(shapes)
    gram, linear, few = p.gram, p.linear, PEER_FRAMES[shapes]
    time_ = np.arange(len(linear))[:, None] / 30
    diagonal = np.zeros_like(linear)
    diagonal[:, :shapes] = 50 * (1 + np.sin(2 * np.pi * (0.1 + 0.01 * np.arange(shapes)) * time_ + np.arange(shapes)))
    pulled = linear.copy()
    pulled[:, :shapes] -= diagonal[:, :shapes] * p.weights
    rows = []
    for label, f, d in ((f"N = {shapes} + 12", linear, None), (f"N = {shapes} + 12, diagonal", pulled, diagonal)):
        part, extra = slice(few), 0.0 if d is None else d[:few]
        runs = [
            ("blendcap", len(f), lambda f=f, d=d: solve_box(gram, f, diagonal=d)),
            ("DAQP update", few, lambda f=f, d=d: run_daqp(gram, f, few, d)),
            ("PIQP update", few, lambda f=f, d=d: run_piqp(gram, f, few, d)),
        ]
        checked = [("blendcap", runs[0][1], lambda run=runs[0][2]: run()[1].max_kkt)] + [
            (name, frames, lambda run=run, f=f, part=part, extra=extra: residual(gram, f[part], run(), extra))
            for name, frames, run in runs[1:]
        ]
        rows += compare(label, checked, rounds)
    return rows


def sequence_rows(shapes, rounds):
    p = ict_problem(shapes)
    gram, linear, few = p.gram, p.linear, SEQUENCE_FRAMES[shapes]
    links = np.full(len(gram), COUPLING)
    exact = solve_box_sequence(gram, linear[:few], links)[0]
    runs = [
        ("blendcap", len(linear), lambda: solve_box_sequence(gram, linear, links)[1].max_kkt),
        (
            SPARSE,
            few,
            lambda: np.abs(run_piqp_sequence(gram, linear[:few], COUPLING) - exact).max(),
        ),
    ]
    return compare(f"N = {shapes} + 12, sequence, c = {COUPLING:g}", runs, rounds)


def compile_seconds():
    """Seconds of processor time of a first solve: nothing cached, then all cached."""
    code = "import numpy as np, time; from blendcap.numerics.boxls import solve_box; "
    code += "from blendcap.numerics.boxseq import solve_box_sequence; t = time.process_time(); "
    code += "g, f = np.eye(9), np.ones((100, 9)); solve_box(g, f); a = time.process_time(); "
    code += "solve_box_sequence(g, f, np.ones(9)); print(a - t, time.process_time() - a)"
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"NUMBA_CACHE_DIR": folder}
        command = [sys.executable, "-c", code]
        return [
            [float(s) for s in subprocess.run(command, env=environment, check=True, capture_output=True).stdout.split()]
            for _ in range(2)
        ]


def long_take():
    """45,817 frames of 100 markers on 140 shapes, the forming of the linear terms included."""
    p = ict_problem(140, 100)
    targets = np.resize(p.targets, (45817, p.targets.shape[1]))
    gram, basis = p.gram, p.basis
    return seconds(lambda: solve_box(gram, 0.25 - targets @ basis)[1].max_kkt)


def processor():
    """Name and nominal frequency, and the widest vectors: the peers' speed depends on them too."""
    info = Path("/proc/cpuinfo")
    lines = [line.split(":") for line in info.read_text().splitlines() if ":" in line] if info.exists() else []
    facts = {name.strip(): value.strip() for name, value in reversed(lines)}
    name, speed = facts.get("model name", platform.processor()), facts.get("cpu MHz")
    wide = ", AVX-512" if "avx512f" in facts.get("flags", "") else ""
    return f"{name} ({speed} MHz{wide})" if speed else name


def main():
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    for shapes in (53, 140):  # compile before the clock runs
        p = ict_problem(shapes)
        solve_box(p.gram, p.linear[:100], diagonal=np.ones((100, len(p.gram))))
        solve_box(p.gram, p.linear[:100])
    rows = [row for shapes in (53, 140) for row in frame_rows(shapes, rounds)]
    rows += [row for shapes in (53, 140) for row in sequence_rows(shapes, rounds)]
    spent, kkt = long_take()
    verdict = "met" if spent < TARGET_SECONDS else "missed"
    (cold, cold_sequence), (cached, cached_sequence) = compile_seconds()
    write_section(
        "Exact box-constrained solvers",
        "python benchmarks/box_solvers.py",
        "\n".join(
            [
                f"One core of {processor()}, load {os.getloadavg()[0]:.1f} when done, {rounds} interleaved rounds;",
                f"processor time of runs that last {LEAST:g} s at least, so that caches are warm for all",
                "(our first call after another program's work takes a tenth to a quarter longer);",
                f"DAQP {version('daqp')}, PIQP {version('piqp')}.",
                "ICT-FaceKit, the real performance alex_rom_3, 50 markers, 0.2 mm noise, ridge 0.4",
                "(dummies 0.04), L1 0.5 on shapes. Vectors of 512 bits where the processor has them.",
                "KKT is `max |a - clip(a - gradient / (2 diag H), 0, 1)|`.",
                "",
                "| problem | peer | frames/s | peer frames/s | ratio: median (range) | target | KKT | peer KKT |",
                "|---|---|---|---|---|---|---|---|",
                *rows,
                "",
                "45,817 frames of 100 markers on 140 + 12 unknowns, linear terms formed too:",
                f"{spent:.2f} s, KKT {kkt:.0e}; target {TARGET_SECONDS:g} s: {verdict}.",
                f"First call, processor time: solve_box {cold:.1f} s cold, {cached:.2f} s cached; solve_box_sequence",
                f"{cold_sequence:.1f} s and {cached_sequence:.2f} s more.",
            ]
        ),
    )


if __name__ == "__main__":
    main()
