"""Plots and the report: they show the numbers, escape every name and ask nothing from outside."""

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from blendcap.data import Animation, Binding, Certificate, InputError, Mesh, Rig, Solution, SurfacePoints, triangulate
from blendcap.view import Film, plots, write_comparison, write_plot, write_report
from blendcap.view.comparison import comparison, plot_conflict
from blendcap.view.comparison import plot_comparison as plots_of
from blendcap.view.concerns import concerns
from blendcap.view.style import inline_svg, plain, thinned

NASTY = '<b onclick="x">&\'$a$'
FRAMES, MARKERS = 40, 6


@pytest.fixture(scope="module")
def rig():
    """A bent sheet with three shapes, of which the first two undo each other."""
    n = 13
    x, y = np.meshgrid(np.linspace(-60, 60, n), np.linspace(80, -80, n))
    index = np.arange(n * n).reshape(n, n)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], -1).reshape(-1, 4)
    vertices = np.stack([x, y, 40 - (x / 12) ** 2], -1).reshape(-1, 3)
    deltas = np.zeros((3, n * n, 3), dtype=np.float32)
    deltas[0, :, 0], deltas[1, :, 0], deltas[2, :60, 2] = 5, -6, 9
    return Rig(Mesh(vertices, triangulate(quads)), deltas, ("mouthLeft", "mouthRight", NASTY), name=f"rig {NASTY}")


@pytest.fixture(scope="module")
def binding(rig):
    names = (*tuple(f"m{i}" for i in range(MARKERS - 1)), NASTY)
    points = SurfacePoints.at_vertices(names, np.linspace(5, 160, MARKERS).astype(int), rig.mesh)
    return Binding(
        points, np.eye(3), np.zeros(3), 1.0, np.zeros((MARKERS, 3)), np.array([2.0, 0.7, 0.6]), automatic=True
    )


@pytest.fixture(scope="module")
def solution(rig, binding):
    rng = np.random.default_rng(0)
    weights = np.stack([np.linspace(0, 1, FRAMES), np.linspace(0.8, 0, FRAMES), np.full(FRAMES, 1.0)], 1)
    head = np.tile(np.eye(4), (FRAMES, 1, 1))
    head[:, 0, 3] = np.arange(FRAMES)
    fitted = np.stack([binding.points.positions(rig.mesh.with_vertices(rig.pose(row))) for row in weights])
    away = rng.normal(size=fitted.shape) * np.array([0.2, 0.2, 0.2, 3, 0.2, 0.2])[:, None]
    away[5:30, 1] = np.nan
    residuals = np.linalg.norm(away, axis=2)
    rms = np.sqrt(np.nanmean(residuals**2, axis=1))
    return Solution(
        animation=Animation(weights, rig.names, 30.0, head=head),
        residuals=residuals,
        rms=rms,
        energies={"markers": rms**2},
        certificate=Certificate(2.5e-12, 4.0, True, np.full(FRAMES, 1e-12)),
        marker_names=binding.points.names,
        helmet=np.cumsum(rng.normal(size=(FRAMES, 6)), axis=0) * 0.01,
        unseen={NASTY: 1.5},
        targets=fitted + away,
        fitted=fitted,
        settings={"method": NASTY},
        seconds={"solve": 0.5},
    )


ALL = {
    "rms": lambda rig, solution, binding: plots.plot_rms(solution),
    "sum": lambda rig, solution, binding: plots.plot_weight_sum(solution.animation),
    "shapes": lambda rig, solution, binding: plots.plot_shapes(solution.animation),
    "markers": lambda rig, solution, binding: plots.plot_markers(rig, solution),
    "helmet": lambda rig, solution, binding: plots.plot_helmet(solution),
    "head": lambda rig, solution, binding: plots.plot_head(solution.animation),
    "errors": lambda rig, solution, binding: plots.plot_marker_errors(solution),
    "convergence": lambda rig, solution, binding: plots.plot_convergence(binding),
}


@pytest.mark.parametrize("name", ALL)
def test_every_plot_is_written_and_is_the_same_again(name, rig, solution, binding, tmp_path):
    for copy in ("a", "b"):
        write_plot(tmp_path / f"{copy}.svg", ALL[name](rig, solution, binding))
    text = (tmp_path / "a.svg").read_bytes()
    assert text == (tmp_path / "b.svg").read_bytes()
    assert text.count(b"<path") > 5
    with pytest.raises(InputError, match=r"end its name with \.png, \.svg or \.pdf"):
        write_plot(tmp_path / "a.bmp", ALL[name](rig, solution, binding))


def test_curves_hold_the_numbers(rig, solution):
    curve = plots.plot_rms(solution).axes[0].lines[0]
    np.testing.assert_array_equal(curve.get_xydata(), np.stack([solution.animation.times, solution.rms], 1))
    curve = plots.plot_weight_sum(solution.animation).axes[0].lines[0]
    np.testing.assert_allclose(curve.get_ydata(), solution.animation.weights.sum(1))
    upper, lower = plots.plot_helmet(solution).axes
    np.testing.assert_array_equal([line.get_ydata() for line in upper.lines], solution.helmet[:, :3].T)
    np.testing.assert_allclose([line.get_ydata() for line in lower.lines], np.degrees(solution.helmet[:, 3:]).T)
    upper, _ = plots.plot_head(solution.animation).axes
    np.testing.assert_array_equal(upper.lines[0].get_ydata(), np.arange(FRAMES))


def test_motion_says_its_units_its_directions_and_what_moves(solution):
    bare = replace(solution, animation=replace(solution.animation, head=None))
    figures = [plots.plot_helmet(solution), plots.plot_helmet(bare), plots.plot_head(solution.animation)]
    titles = [figure.axes[0].get_title(loc="left") for figure in figures]
    assert "left of the head's motion" in titles[0] and "helmet" in titles[1] and "first frame" in titles[2]
    for figure in figures:
        upper, lower = figure.axes
        assert (upper.get_ylabel(), lower.get_ylabel()) == ("shift, mm", "turn, degrees")
        assert [line.get_label() for line in upper.lines] == ["x, to the subject's left", "y, up", "z, forward"]
        assert lower.get_legend() is not None
    nose, crown = np.array([0, 0, 90.0]), np.array([0, 90.0, 0])
    words = {"nods down": (nose, [0, -1, 0]), "looks left": (nose, [1, 0, 0]), "tilts right": (crown, [-1, 0, 0])}
    for line, axis in zip(lower.lines, np.eye(3), strict=True):
        place, towards = words[line.get_label().split(", ")[1]]
        moved = Rotation.from_rotvec(0.1 * axis).apply(place) - place
        assert moved @ towards > 0.99 * np.linalg.norm(moved)


def test_markers_plot_shows_the_worst_frame_from_front_and_side(rig, solution):
    worst = int(np.argmax(solution.rms))
    front, side = plots.plot_markers(rig, solution).axes
    red = next(line for line in front.lines if line.get_label() == "marker")
    np.testing.assert_array_equal(red.get_xydata(), solution.targets[worst][:, :2])
    blue = next(line for line in side.lines if line.get_label() == "on the face")
    np.testing.assert_array_equal(blue.get_xydata(), solution.fitted[worst][:, [2, 1]] * [-1, 1])
    with pytest.raises(InputError, match="no frame 40 in the solution; it has 40"):
        plots.plot_markers(rig, solution, 40)
    with pytest.raises(InputError, match="does not hold its markers"):
        plots.plot_markers(rig, replace(solution, targets=None))


def test_shapes_are_sorted_by_activity_and_still_ones_are_left_out(solution):
    titles = [axes.get_title(loc="left") for axes in plots.plot_shapes(solution.animation).axes if axes.get_visible()]
    assert titles == ["mouthLeft", "mouthRight"]


def test_marker_errors_leave_out_what_was_not_seen(solution):
    residuals = np.array([[3.0, np.nan], [4.0, np.nan]])
    rms, p95 = plots.marker_errors(replace(solution, residuals=residuals, marker_names=("a", "b")))
    assert rms[0] == pytest.approx(np.sqrt(12.5)) and np.isnan(rms[1]) and np.isnan(p95[1])


@pytest.mark.parametrize("plot, without", [(plots.plot_helmet, "helmet"), (plots.plot_head, "head motion")])
def test_plots_of_what_is_not_there_say_so(plot, without, solution):
    bare = replace(solution, helmet=None)
    still = Animation(solution.animation.weights, solution.animation.names, 30.0)
    with pytest.raises(InputError, match=without):
        plot(bare if plot is plots.plot_helmet else still)


def test_thinned_curves_keep_their_peaks():
    times, values = np.arange(20_000.0), np.zeros(20_000)
    values[[123, 15_000]] = 1, -2
    values[7_000:9_000] = np.nan
    few_times, few = thinned(times, values)
    assert len(few) <= 500 and (np.diff(few_times) > 0).all()
    assert np.nanmax(few) == 1 and np.nanmin(few) == -2
    assert few_times[np.nanargmax(few)] == 123
    assert np.isnan(few).any()
    short = np.arange(10.0)
    assert thinned(short, short)[1] is short


def test_inline_plots_follow_the_page(solution):
    svg = inline_svg(plots.plot_rms(solution))
    assert svg.startswith("<svg") and "var(--ink)" in svg and "xmlns" not in svg
    assert "#2b2f37" not in svg
    assert re.match(r'<svg role="img" style="max-width:800pt" viewBox', svg)


class Page(HTMLParser):
    """Tags, links and text of a page; void and raw elements as browsers treat them."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.links, self.words, self.open = [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        self.links += [value for key, value in attributes if key in ("src", "href", "xlink:href", "poster", "srcset")]

    def handle_data(self, data):
        self.words.append(data)


@pytest.fixture(scope="module")
def page(rig, solution, binding, tmp_path_factory):
    tmp_path = tmp_path_factory.mktemp("report")
    (tmp_path / "film.mp4").write_bytes(b"not really a film")
    path = tmp_path / "report.html"
    write_report(path, rig, solution, binding=binding, video=tmp_path / "film.mp4", next_steps=[f"Open {NASTY}."])
    return path.read_text(encoding="utf-8")


def test_the_report_asks_nothing_from_outside(page):
    parsed = Page(page)
    assert {tag for tag, _ in parsed.tags} & {"script", "link", "iframe", "object", "base", "form"} == set()
    assert len(parsed.links) > 3
    assert all(link.startswith(("data:", "#")) for link in parsed.links)
    assert not re.search(r"https?://|//[a-z]+\.|@import|url\((?!#)", re.sub(r'"data:[^"]*"', '""', page))
    assert sum(tag == "video" for tag, _ in parsed.tags) == 1


def test_the_report_escapes_every_name(page):
    parsed = Page(page)
    assert not any("onclick" in attributes for _, attributes in parsed.tags)
    assert not any(tag == "b" and attributes for tag, attributes in parsed.tags)
    text = "".join(parsed.words)
    # title twice, a concern, the tables of shapes, markers and settings, the marker's bar, the next step
    assert text.count(NASTY) >= 8


def test_the_report_tells_the_numbers(page, solution):
    text = " ".join(Page(page).words)
    assert f"{solution.rms.mean():.2f} mm" in text
    assert "2.5e-12" in text and "proved for every frame" in text
    assert "40 frames at 30 a second (1.3 s), 6 markers, 3 shapes" in text
    assert "62.5%" in text  # marker m1 was missing in 25 of 40 frames


def test_large_or_missing_films_stay_beside_the_page(rig, solution, tmp_path, monkeypatch):
    monkeypatch.setattr("blendcap.view.report.LARGEST_FILM", 3)
    (tmp_path / "film.mp4").write_bytes(b"long")
    for film in ("film.mp4", "missing.mp4"):
        write_report(tmp_path / "a.html", rig, solution, video=tmp_path / film)
        text = (tmp_path / "a.html").read_text(encoding="utf-8")
        assert f"The film lies beside this page: {film}." in text and "<video" not in text


def test_a_bare_solution_makes_a_report_too(rig, solution, tmp_path):
    silent = np.full_like(solution.residuals, np.nan)
    still = Animation(np.zeros((FRAMES, 3)), rig.names, 30.0)
    bare = replace(
        solution, animation=still, residuals=silent, rms=np.full(FRAMES, np.nan), targets=None, fitted=None,
        helmet=None, unseen={}, settings={}, seconds={}, energies={},
    )  # fmt: skip
    write_report(tmp_path / "a.html", rig, bare)
    write_report(tmp_path / "b.html", rig, bare)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


def test_concerns_point_at_what_is_wrong(rig, solution, binding):
    said = "\n".join(concerns(rig, solution, binding))
    assert "found automatically" in said
    assert f"cannot tell 1 of the shapes, which follow their partner or are a guess: {NASTY} (not at all)." in said
    assert re.search(r"Marker m3 is off by \d\.\d mm (all the time|from )", said)
    assert "Often missing, in so many of the frames: m1 (62%)." in said
    assert "mouthLeft and mouthRight undo each other" in said
    hundred = replace(rig, bounds=100 * rig.bounds)  # in which these weights are next to nothing
    assert "undo each other" not in "\n".join(concerns(hundred, solution, binding))
    assert re.search(r"upper limit.*\(100%\)", said)
    assert "did not reach its optimum" not in said
    failed = replace(solution, certificate=replace(solution.certificate, converged=False))
    assert "did not reach its optimum" in concerns(rig, failed)[0]


def test_of_unseen_shapes_blinks_are_said_first_and_then_those_that_move_most(solution):
    names = ("eyeBlinkLeft", "a", "EyeBlink_R", "b", "c", "d", "e", "f")
    deltas = np.zeros((len(names), 3, 3), dtype=np.float32)
    deltas[:, 0, 0] = [1, 2, 1, 5, -4, 3, 1, 0.5]
    bounds = np.tile([0.0, 1.0], (len(names), 1))
    bounds[1] = [-10, 1]  # moves most of all, downwards
    rig = Rig(Mesh(np.eye(3), [[0, 1, 2]]), deltas, names, bounds=bounds)
    unseen = dict.fromkeys(names, 0.5)
    solution = replace(solution, animation=Animation(np.zeros((FRAMES, len(names))), names, 30.0), unseen=unseen)
    said = [s for s in concerns(rig, replace(solution, held=("e", "eyeBlinkLeft", "b"))) if "cannot tell" in s]
    assert said[0].startswith(
        "The markers cannot tell the blinks, which are partly a guess: eyeBlinkLeft (±0.50), EyeB"
    )
    assert "cannot tell 2 more of the shapes, which are held" in said[1] and "first: b (±0.50), e (±0.50)." in said[1]
    assert "come first: a (±0.50), c (±0.50), d (±0.50), f (±0.50)." in said[2]
    said = [s for s in concerns(rig, replace(solution, held=names)) if "cannot tell" in s]
    assert "the blinks, which are held at rest" in said[0] and "6 more of the shapes" in said[1] and len(said) == 2
    assert said[1].endswith("a (±0.50), b (±0.50), c (±0.50), d (±0.50) and 2 more.")


def test_markers_that_were_exchanged_are_named_with_each_other(rig, solution, binding):
    places = binding.points.positions(rig.mesh)
    offsets = np.full((MARKERS, 3), 1.0)
    offsets[0], offsets[4] = places[4] - places[0], places[0] - places[4]
    said = concerns(rig, solution, replace(binding, offsets=offsets, automatic=False))
    far = np.linalg.norm(offsets[0])
    for one, other in (("m0", "m4"), ("m4", "m0")):
        sentence = (
            f"In the neutral pose {one} lies {far:.0f} mm from its place, near that of {other}, half of the others"
        )
        assert any(s.startswith(sentence) for s in said)
    lost = np.full((MARKERS, 3), 1.0)
    lost[2] = [0, 0, 60]
    alone = [s for s in concerns(rig, solution, replace(binding, offsets=lost)) if "neutral pose" in s]
    assert len(alone) == 1 and "m2 lies 60 mm from its place, half" in alone[0]


def test_patches_that_disagree_and_markers_far_off_are_said(rig, solution):
    apart = np.zeros_like(solution.animation.weights)
    apart[: len(apart) // 2, 0] = 0.5
    said = "\n".join(concerns(rig, replace(solution, conflict=apart, residuals=np.full_like(solution.residuals, 4.0))))
    assert f"disagree by more than 0.3, in so many of the frames: {rig.names[0]} (50%)" in said
    assert "The markers lie 4.0 mm off the face" in said and "may not begin neutral" in said


def test_a_good_solve_raises_no_concern(rig, solution):
    good = replace(
        solution,
        animation=Animation(solution.animation.weights * [0.5, 0, 0.5], rig.names, 30.0),
        residuals=np.full((FRAMES, MARKERS), 0.3),
        unseen={},
    )
    assert concerns(rig, good) == []


def test_the_markers_alone_stand_beside_the_hybrid_solve(rig, solution, tmp_path):
    weights = solution.animation.weights.copy()
    weights[20:24, 0] += 0.4
    changed = replace(solution.animation, weights=weights)
    patches = Animation(weights[:, :1], rig.names[:1], 30.0)
    conflict = np.zeros_like(weights)
    conflict[[2, 38], [1, 2]] = 0.6, 0.3
    hybrid = replace(solution, animation=changed, conflict=conflict)
    (axes,) = plot_conflict(hybrid).axes
    frames = [f"{plain(rig.names[1])}, frame 2", f"{plain(rig.names[2])}, frame 38"]
    assert [text.get_text() for text in axes.texts] == frames and axes.get_ylim()[1] > 0.6
    html = comparison(rig, solution, hybrid, patches)
    assert "not what the patches say" in html
    agreed = comparison(rig, solution, replace(hybrid, conflict=None), patches)
    assert "not what the patches say" not in agreed
    assert re.search(r"Frame 2[0-3], ", html) and html.count("<img") == 1  # no other is a second away
    assert "mouthLeft" in agreed and "mouthRight" not in agreed  # which did not change
    write_report(tmp_path / "r.html", rig, hybrid, alone=solution, patches=patches)
    assert "What the paint changed" in (tmp_path / "r.html").read_text(encoding="utf-8")
    blind = replace(solution, unseen={rig.names[0]: 0.5})
    write_report(tmp_path / "told.html", rig, replace(hybrid, unseen={}), alone=blind, patches=patches)
    assert (tmp_path / "told.html").read_text(encoding="utf-8").count("unseen, told by the paint") == 1
    write_report(tmp_path / "alone.html", rig, hybrid)
    assert "What the paint changed" not in (tmp_path / "alone.html").read_text(encoding="utf-8")
    film = tmp_path / "both.gif"
    short = [Animation(a.weights[:3], a.names, a.rate) for a in (solution.animation, changed)]
    assert write_comparison(film, rig, *short, Film((80, 90), (0.0,))) == 3 and film.stat().st_size > 0
    with pytest.raises(InputError, match="have 3 and 40 frames; compare two of the same take"):
        write_comparison(film, rig, short[0], changed)


def test_the_plot_of_two_solves_draws_three_lines_for_a_shape_that_changed(solution):
    changed = replace(solution.animation, weights=np.clip(solution.animation.weights - [0, 0.3, 0], 0, 1))
    patches = Animation(changed.weights, changed.names, 30.0)
    figure = plots_of(solution, replace(solution, animation=changed), patches)
    drawn = [axes for axes in figure.axes if axes.get_title(loc="left") == "mouthRight"]
    assert len(drawn) == 1 and len(figure.axes) == 1
    alone, hybrid = (line.get_ydata() for line in drawn[0].lines[:2])
    np.testing.assert_allclose(alone, solution.animation.weights[:, 1])
    np.testing.assert_allclose(hybrid, changed.weights[:, 1])
