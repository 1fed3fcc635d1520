"""Action units from painted strokes: labels, classifiers on one person and on others, curves, refusals."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.signal import savgol_filter

from blendcap.data import Animation, InputError
from blendcap.io.models import read_model, write_model
from blendcap.makeup import training
from blendcap.makeup.augmentation import thinned, warped
from blendcap.makeup.classifier import margin, tally
from blendcap.makeup.curves import WINDOWS, classify
from blendcap.makeup.features import COARSE, MEAN_MOTION, MOTION, SOFT, features, fine_motion, gabor, gabor_bank, motion
from blendcap.makeup.intensity import measure_intensity
from blendcap.makeup.labels import soft
from blendcap.makeup.lesson import Lesson, untold_units
from blendcap.makeup.packing import KIND, VERSION, pack, unpack
from blendcap.makeup.patches import Patches, flows, laid_over
from blendcap.makeup.training import train_classifier
from blendcap.makeup.units import Region, shown_as_one, shows
from blendcap.view.confusion import plot_confusion
from toy_makeup import RATE, REGION, draw, perform

TABLE = {"AU1+2": {"browInnerUp": 1.0}, "AU4": {"browDownLeft": 0.5}, "AU9": {"noseSneerLeft": 1.0}}


@pytest.fixture(scope="module")
def lesson():
    return perform(repetitions=3)


@pytest.fixture(scope="module", params=["intensity", "svm"])
def trained(request, lesson):
    patches, shown, _ = lesson
    return train_classifier(patches, shown, regions=[REGION], method=request.param)


def test_gabor_filters_are_blind_to_a_constant_and_see_their_own_direction():
    assert len(gabor_bank()) == 8
    assert gabor(np.full((44, 56), 200, dtype=np.uint8))[:, 5:-5, 5:-5].max() < 0.2
    x = np.arange(56)
    stripes = np.tile(127 + 120 * np.cos(2 * np.pi * x / 9), (44, 1)).astype(np.uint8)
    power = gabor(stripes)[:, 8:-8, 8:-8].mean((1, 2))
    assert power.argmax() == 4  # the wavelength of 9 pixels, across
    assert gabor(np.ascontiguousarray(stripes[:, ::-1]))[4].mean() == pytest.approx(power[4], rel=0.2)


def test_intensity_is_found_without_labels_and_points_away_from_rest():
    rise = np.concatenate([np.linspace(0, 1, 40), np.linspace(1, 0, 40)])
    for unit in REGION.units:
        frames = [draw({unit: a})["forehead" if unit == "AU1+2" else "glabella"] for a in rise]
        pictures = soft(np.stack(frames))
        scale = measure_intensity(pictures, pictures[0])
        assert np.corrcoef(scale.amount(pictures), rise)[0, 1] > 0.9
        levels = scale.level(pictures)
        assert levels[0] == 0 and levels[40] == 3 and set(levels) == {0, 1, 2, 3}
        assert (np.diff(scale.centers) > 0).all()


def test_left_out_showings_are_recognized(trained):
    (model,) = trained.models
    assert model.scores["unit"] > 0.97
    assert model.confusion.shape == (4, 4) and model.confusion.sum() > 200
    assert np.trace(model.confusion) / model.confusion.sum() == pytest.approx(model.scores["unit"])
    assert (model.errors < 0.15).all()


def test_a_machine_is_linear_in_the_features_and_answers_for_unseen_takes(trained):
    patches, _, truth = perform(repetitions=2, seed=5)
    intensity, probability = trained(patches)
    assert trained.units == REGION.units and intensity.shape == truth.shape
    clear = truth.max(1) > 0.3
    assert (intensity.argmax(1) == truth.argmax(1))[clear].mean() > 0.97
    for u in range(3):
        assert np.corrcoef(intensity[:, u], truth[:, u])[0, 1] > 0.93
    assert ((probability >= 0) & (probability <= 1)).all()


def test_another_person_is_recognized_once_laid_over_the_first(trained):
    patches, _, truth = perform(repetitions=2, build=5.0, seed=6)
    curves = classify(trained, patches, table=TABLE)
    assert curves.names == ("browInnerUp", "browDownLeft", "noseSneerLeft")
    scaled, clear = truth * [1.0, 0.5, 1.0], truth.max(1) > 0.3
    plain = classify(trained, patches, table=TABLE, aligned=False)
    errors = [np.abs(told.weights - scaled).mean() for told in (curves, plain)]
    right = [((told.weights / [1, 0.5, 1]).argmax(1) == truth.argmax(1))[clear].mean() for told in (curves, plain)]
    assert errors[0] < 0.04 and errors[0] < 0.5 * errors[1]
    assert right[0] > 0.99 and right[1] < 0.8


@pytest.mark.parametrize("aligned", [True, False])
def test_strokes_that_were_painted_anew_are_told_as_strongly(lesson, aligned):
    region = REGION._replace(aligned=aligned)
    machine = train_classifier(*lesson[:2], regions=[region])
    bare = replace(machine, models=[replace(machine.models[0], scales=np.ones((3, 2)))])
    patches, _, truth = perform(repetitions=2, seed=5)
    copies = [warped(patches, region, 90 + k, 2.0) for k in range(3)]
    laid = [laid_over(copy, flows(copy.neutral, machine.neutral)) if aligned else copy for copy in copies]
    shown, errors = truth > 0.5, []
    plain = bare(patches)[0][shown].mean()
    for told_by in (machine, bare):
        told = np.concatenate([told_by(*pair)[0] for pair in zip(copies, laid, strict=True)]).clip(0, 1)
        errors.append(abs(1 - told[np.tile(shown, (3, 1))].mean() / plain))
    assert errors[0] < 0.2 and errors[0] < 0.7 * errors[1]


def test_curves_are_smooth_bounded_and_say_how_sure_they_are(trained):
    patches, _, _ = perform(repetitions=1, seed=7)
    halved = Patches(
        patches.images, patches.rate, np.where(np.arange(len(patches.sure)) < 60, 0.5, 1.0), patches.neutral
    )
    curves, unsure = classify(trained, patches, table=TABLE), classify(trained, halved, table=TABLE)
    assert curves.weights.min() >= 0 and curves.weights.max() <= 1
    np.testing.assert_allclose(unsure.confidence[:40], 0.5 * curves.confidence[:40], atol=1e-9)
    np.testing.assert_allclose(unsure.confidence[80:], curves.confidence[80:], atol=1e-9)
    quiet = classify(trained, patches, table=TABLE, everywhere=False)
    assert quiet.confidence[0].max() < 0.05 < curves.confidence[0].max()


@pytest.mark.parametrize(("rate", "frames"), [(10.0, 5), (24.0, 9), (60.0, 21)])
def test_curves_are_smoothed_over_seconds_but_five_frames_at_least(trained, rate, frames):
    patches, _, _ = perform(repetitions=1, seed=7)
    raw, _ = trained(patches)
    told = classify(trained, replace(patches, rate=rate), table=TABLE, aligned=False)
    frames = frames if trained.method == "intensity" else max(5, 2 * (round(WINDOWS["svm"] * rate) // 2) + 1)
    smoothed = np.clip(savgol_filter(raw[:, 2].clip(0, 1), frames, 2), 0, 1)
    np.testing.assert_allclose(told.weights[:, 2], smoothed, atol=1e-6)


def test_lids_are_smoothed_less_than_brows(trained):
    patches, _, _ = perform(repetitions=1, seed=7)
    units = ("AU45L", "AU4", "AU9")
    model = replace(trained.models[0], region=trained.models[0].region._replace(units=units))
    raw, _ = trained(patches)
    table = {"AU45L": {"lid": 1.0}, "AU4": {"brow": 1.0}, "AU9": {"nose": 1.0}}
    told = classify(
        replace(trained, models=[model]), replace(patches, rate=30.0), table=table, aligned=False, full_blinks=False
    )
    frames = 7 if trained.method == "intensity" else 13
    np.testing.assert_allclose(told.weights[:, 0], np.clip(savgol_filter(raw[:, 0], frames, 2), 0, 1), atol=1e-6)


def test_a_lid_that_is_told_more_than_shut_is_shut(trained):
    """A shape that is half on when the eye is shut is half on, however strongly it is told."""
    patches, _, _ = perform(repetitions=1, seed=7)
    (model,) = trained.models
    region = model.region._replace(units=("AU45L", "AU4", "AU9"))
    strong = replace(trained, models=[replace(model, region=region, scales=np.full((3, 2), [4.0, 1.0]))])
    table = {"AU45L": {"lid": 0.5}, "AU4": {}, "AU9": {}}
    for full_blinks in (True, False):
        lid = classify(strong, patches, table=table, full_blinks=full_blinks).weights[:, 0]
        assert lid.max() == pytest.approx(0.5, abs=0.1) and lid.max() <= 0.5


def test_no_patches_are_refused(trained):
    with pytest.raises(InputError, match="no patches to classify"):
        classify(trained, iter([]), table=TABLE)


def test_smeared_paint_is_not_believed(trained):
    patches, _, _ = perform(repetitions=1, seed=7)
    smeared = dict(patches.images)
    smeared["glabella"] = np.where(np.arange(len(patches.sure))[:, None, None] < 70, smeared["glabella"], 255)
    spoilt = Patches(smeared, patches.rate, patches.sure, patches.neutral)
    clean, dirty = classify(trained, patches, table=TABLE), classify(trained, spoilt, table=TABLE)
    np.testing.assert_allclose(dirty.confidence[:50], clean.confidence[:50], atol=1e-9)
    assert clean.confidence[90:].min() > 0.2 and dirty.confidence[90:].max() < 0.02


def test_blocks_give_the_answer_of_the_whole(trained):
    patches, _, _ = perform(repetitions=1, build=2.0, seed=7)
    cuts = [slice(0, 50), slice(50, 60), slice(60, None)]
    blocks = [
        Patches({n: p[cut] for n, p in patches.images.items()}, patches.rate, patches.sure[cut], patches.neutral)
        for cut in cuts
    ]
    whole, parts = classify(trained, patches, table=TABLE), classify(trained, iter(blocks), table=TABLE)
    np.testing.assert_allclose(parts.weights, whole.weights, atol=1e-6)
    np.testing.assert_allclose(parts.confidence, whole.confidence, atol=1e-6)


def test_two_units_that_move_one_shape_agree_on_the_stronger(trained, lesson):
    patches, _, truth = lesson
    both = {"AU1+2": {"lift": 1.0}, "AU4": {"lift": 1.0}, "AU9": {}}
    curves = classify(trained, patches, table=both)
    assert curves.names == ("lift",)
    assert np.corrcoef(curves.weights[:, 0], truth[:, :2].max(1))[0, 1] > 0.93


def test_votes_of_pairs_elect_the_class_that_wins_all():
    values = np.array([[1.0, 2.0, -0.5], [-1.0, -1.0, 0.2]])  # pairs 0-1, 0-2, 1-2
    votes = tally(values, 3)
    np.testing.assert_array_equal(votes.argmax(1), [0, 1])
    assert (margin(votes) > 0).all()


def test_features_of_every_kind_follow_their_input():
    image = draw({})["forehead"]
    for kind in ("gabor", "hog", "edges", "gabor+motion", "fine"):
        same = features([np.stack([image, image])], [image], kind)
        moved = features([np.stack([image, draw({"AU1+2": 1.0})["forehead"]])], [image], kind)
        np.testing.assert_allclose(same[0], same[1], atol=1e-6)
        assert np.linalg.norm(moved[1] - moved[0]) > 0.1 * np.linalg.norm(moved[0])
    with pytest.raises(InputError, match="features 'haar' are unknown"):
        features([image[None]], [image], "haar")


def test_motion_is_how_far_a_stroke_has_moved():
    image = np.zeros((44, 56), dtype=np.uint8)
    image[18:22, 8:48] = 255
    for shift in (-3, 2, 4):
        moved = motion(image)(np.roll(image, shift, axis=0))
        still = motion(image)(image)
        paint = cv2.GaussianBlur(image, (0, 0), SOFT).sum() / 255 * MOTION / COARSE**2
        assert moved[..., 1].sum() / paint == pytest.approx(shift, rel=0.15)
        assert abs(moved[..., 0].sum() / paint) < 0.2 and np.abs(still).max() < 1e-3 * MOTION


def with_rising_stroke(rise: int, width: int = 3) -> np.ndarray:
    """A patch with two long strokes that keep still and a short one that rises."""
    image = np.zeros((44, 56), dtype=np.uint8)
    image[[8, 9, 24, 25], 6:50] = 255
    image[41 - width - rise : 41 - rise, 20:40] = 255
    return image


def test_a_thin_stroke_between_others_that_keep_still_is_seen_to_move():
    paint = cv2.GaussianBlur(with_rising_stroke(0), (0, 0), SOFT).astype(np.float32) / 255 * MOTION
    weight = cv2.resize(paint, (14, 11), interpolation=cv2.INTER_AREA)[9, 6:9].mean()
    for rise in (1, 2):
        frame, rest = with_rising_stroke(rise), with_rising_stroke(0)
        fine = fine_motion(rest)(frame)[..., 1] / MEAN_MOTION
        share = motion(rest)(frame)[9, 6:9, 1].mean() / weight
        assert fine[9, 6:9].mean() == pytest.approx(-rise, rel=0.3)
        assert abs(share + rise) > abs(fine[9, 6:9].mean() + rise)
        assert np.abs(fine[[2, 6], 2:11]).max() < 0.1
        assert np.isfinite(fine).all()


def test_mean_motion_does_not_tell_how_broad_a_stroke_is():
    def seen(kind, width):
        return kind(with_rising_stroke(0, width))(with_rising_stroke(2, width))[9, 6:9, 1].mean()

    assert seen(fine_motion, 5) == pytest.approx(seen(fine_motion, 3), rel=0.15)
    assert seen(motion, 5) != pytest.approx(seen(motion, 3), rel=0.3)


def test_takes_teach_together_and_each_unit_need_not_be_in_all():
    first, shown, truth = perform(repetitions=3)
    other, told, _ = perform(repetitions=2, build=2.0, seed=4)
    brow = Lesson(np.where(shown.units == "AU9", "", shown.units), shown.repetitions)
    nose = Lesson(np.where(told.units == "AU9", "AU9", ""), told.repetitions)
    both = train_classifier([first, other], [brow, nose], regions=[REGION])
    assert both.units == REGION.units
    np.testing.assert_array_equal(both.neutral["forehead"], first.neutral["forehead"])
    test, _, truth = perform(repetitions=2, seed=5)
    intensity, _ = both(test)
    clear = truth.max(1) > 0.3
    assert (intensity.argmax(1) == truth.argmax(1))[clear].mean() > 0.9
    with pytest.raises(InputError, match="There are 2 takes of patches, but 1 lessons; give one a take"):
        train_classifier([first, other], brow, regions=[REGION])


def test_intensities_are_read_off_solved_weights_where_these_are_sure(lesson):
    patches, shown, truth = lesson
    names = ("browInnerUp", "browDownLeft", "noseSneerLeft")
    half = Animation(0.5 * truth, names, patches.rate)
    table = {unit: {name: 1.0} for unit, name in zip(REGION.units, names, strict=True)}
    known = replace(shown, weights=half)
    intensity, _ = train_classifier(patches, known, regions=[REGION], table=table)(patches)
    assert np.sqrt(((intensity - 0.5 * truth) ** 2).mean()) < 0.04
    unsure = np.ones_like(truth)
    unsure[:, 0] = 0.2
    mixed = replace(shown, weights=replace(half, confidence=unsure))
    intensity, _ = train_classifier(patches, mixed, regions=[REGION], table=table)(patches)
    assert np.percentile(intensity[:, 0], 99) > 0.8 and np.percentile(intensity[:, 1], 99) < 0.65
    with pytest.raises(InputError, match="lesson's weights have 3 frames"):
        replace(shown, weights=Animation(truth[:3], names, patches.rate))


def test_weights_of_a_lesson_may_be_spelled_otherwise(lesson):
    _, shown, truth = lesson
    names = ("browInnerUp_L", "browInnerUp_R", "browDown_L")
    known = replace(shown, weights=Animation(truth * [1.0, 0.5, 1.0], names, 30.0))
    np.testing.assert_allclose(known.intensity({"browInnerUp": 1.0}), np.minimum(truth[:, 0], 0.5 * truth[:, 1]))
    np.testing.assert_allclose(known.intensity({"browDownLeft": 0.5}), truth[:, 2] / 0.5)
    assert np.isnan(known.intensity({"browDownLeft": 1.0, "browDownRight": 1.0})).all()


@pytest.mark.parametrize("method", ["intensity", "svm"])
def test_copies_of_a_showing_that_is_left_out_are_left_out_too(method):
    """Labels by chance cannot be told from features that are other chance, however exactly the copies repeat both."""
    rng = np.random.default_rng(0)
    on = rng.random(80) < 0.5
    data = training._Data(rng.normal(size=(80, 200)), on[:, None] * 1.0, np.where(on, 3, 0), np.repeat(range(4), 20))
    told, _ = training._left_out(data, [replace(data), replace(data)], method, 0)
    assert abs(np.corrcoef(told[:, 0], on)[0, 1]) < 0.4


def test_patches_that_no_region_looks_at_are_not_asked_for(lesson):
    patches, shown, _ = lesson
    more = replace(
        patches,
        images={**patches.images, "chin": patches.images["forehead"]},
        neutral={**patches.neutral, "chin": patches.neutral["forehead"]},
    )
    classifier = train_classifier(more, shown, regions=[REGION])
    assert set(classifier.neutral) == set(REGION.patches)
    np.testing.assert_allclose(classifier(patches)[0], classifier(more)[0], atol=1e-6)


def test_of_long_lessons_copies_take_every_so_many_frames(lesson, monkeypatch):
    patches, shown, _ = lesson
    frames = len(patches.sure)
    monkeypatch.setattr(training, "COPY", frames // 3)
    parts, rows = thinned([patches, patches], frames // 3)
    assert [len(part.sure) for part in parts] == [-(-frames // 6)] * 2
    np.testing.assert_array_equal(rows[len(rows) // 2 :], frames + rows[: len(rows) // 2])
    np.testing.assert_array_equal(parts[0].images["forehead"][1], patches.images["forehead"][6])
    assert train_classifier(patches, shown, regions=[REGION]).models[0].scores["unit"] > 0.9


def test_what_a_turn_shows_and_which_units_only_ever_come_together():
    assert shows("AU1+2+5", "AU2L") and shows("AU6+43", "AU45R") and shows("AU45L", "AU45L") and shows("AU10L", "AU10")
    assert not shows("AU45L", "AU45R") and not shows("AU4", "AU1") and not shows("AU1", "AU1+2")
    units = ("AU1", "AU2L", "AU2R", "AU10L", "AU10R")
    assert shown_as_one(units, {"", "AU1+2", "AU10L", "AU10R"}) == {"AU1+2": [0, 1, 2], "AU10L": [3], "AU10R": [4]}
    assert shown_as_one(units, {"AU1+2", "AU1", "AU10"}) == {"AU1": [0], "AU2": [1, 2], "AU10": [3, 4]}
    assert shown_as_one(("AU10L", "AU12L"), {"AU10+12L"}) == {"AU10+12L": [0, 1]}
    assert shown_as_one(("smile", "grin"), set()) == {"smile+grin": [0, 1]}
    assert shown_as_one(("smile",), set()) == {"smile": [0]}
    assert shown_as_one(("AU6+43", "AU45"), {"AU6+43", "AU45"}) == {"AU6+43": [0], "AU45": [1]}


def test_warped_copies_differ_a_little_and_are_the_same_for_a_seed(lesson):
    patches = lesson[0]
    once, again, other = (warped(patches, REGION, seed).images["forehead"] for seed in (1, 1, 2))
    np.testing.assert_array_equal(once, again)
    assert (once != other).any() and 0.001 < (once != patches.images["forehead"]).mean() < 0.3
    trained = train_classifier(*perform(repetitions=2)[:2], regions=[REGION], method="svm", warps=1)
    assert trained.models[0].scores["unit"] > 0.9


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"method": "magic"}, "method 'magic' is unknown; choose one of intensity, svm"),
        ({"regions": [Region("eyes", ("eye_left",), ("AU45",))]}, "shows none of the units of the regions"),
        ({"regions": [Region("lips", ("lips",), ("AU4",))]}, "The patch 'lips' is needed, but there are only"),
    ],
)
def test_lessons_that_teach_nothing_are_refused(lesson, change, sentence):
    patches, shown, _ = lesson
    with pytest.raises(InputError, match=sentence):
        train_classifier(patches, shown, **{"regions": [REGION], **change})


def test_a_lesson_of_another_length_or_of_one_showing_is_refused(lesson):
    patches, shown, _ = lesson
    with pytest.raises(InputError, match="The lesson has 10 frames, but the patches have"):
        train_classifier(patches, Lesson(shown.units[:10], shown.repetitions[:10]), regions=[REGION])
    once, lone, _ = perform(repetitions=1)
    with pytest.raises(InputError, match="only once; let the performer repeat it"):
        train_classifier(once, lone, regions=[REGION])


@pytest.mark.parametrize(
    ("spans", "sentence"),
    [
        (
            [(12.0, 36.0, "AU4")],
            "Showing 1, of AU4 from 12 to 36 s, ends after the lesson, which lasts until 10 s; showings",
        ),
        ([(1, 2, "AU4"), (3, 5, "AU1"), (4, 6, "AU2")], "Showings 2 and 3, of AU1 and AU2, overlap; tell what was"),
    ],
)
def test_showings_after_the_end_and_two_at_once_are_refused(spans, sentence):
    with pytest.raises(InputError, match=sentence):
        Lesson.of_spans(spans, 100, 10.0)


def test_showings_may_follow_one_another_and_end_with_the_film():
    lesson = Lesson.of_spans([(8.0, 9.04, "AU4"), (9.0, 10.1, "AU1")], 100, 10.0)
    assert list(np.unique(lesson.repetitions, return_counts=True)[1]) == [80, 10, 10]


def test_a_lesson_that_shows_nothing_says_so(lesson):
    patches, shown, _ = lesson
    rest = Lesson(np.full(len(shown.units), "", dtype=object), np.zeros(len(shown.units), dtype=int))
    with pytest.raises(InputError, match=r"none of the units of the regions \(AU1\+2, .*\); it shows nothing\."):
        train_classifier(patches, rest, regions=[REGION])


def test_a_frozen_film_and_a_showing_of_a_moment_are_refused(lesson):
    patches, shown, _ = lesson
    frozen = replace(patches, images={name: np.broadcast_to(patches.neutral[name], f.shape).copy()
                                      for name, f in patches.images.items()})  # fmt: skip
    with pytest.raises(InputError, match=r"patches of the region .* do not move"):
        train_classifier(frozen, shown, regions=[REGION])
    unit = shown.units[shown.units != ""][0]
    rows = np.flatnonzero(shown.units == unit)
    brief = shown.units.copy()
    brief[rows[3:]] = ""
    with pytest.raises(InputError, match=f"shows {unit.replace('+', '.')} in 3 frames; it takes at least 4"):
        train_classifier(patches, Lesson(brief, shown.repetitions), regions=[REGION])


def test_weights_that_do_not_tell_a_unit_are_named_and_refused_if_they_tell_none(lesson, caplog):
    patches, shown, truth = lesson
    told = Lesson(shown.units, shown.repetitions, Animation(truth[:, 1:2], ("frown",), RATE))
    table = {"AU1+2": {"lift": 1.0}, "AU4": {"frown": 1.0}, "AU9": {"sneer": 1.0}}
    train_classifier(patches, told, regions=[REGION], table=table)
    assert "do not tell how strongly AU1+2, AU9 are shown, and the pictures must" in caplog.text
    other = Lesson(shown.units, shown.repetitions, Animation(truth[:, :1], ("tail",), RATE))
    assert untold_units([told, other], [REGION], "intensity", table) == ["AU1+2", "AU9"]  # one of two lessons is enough
    with pytest.raises(InputError, match=r"tell of none of its units \(AU1\+2, AU4, AU9\)"):
        train_classifier(patches, told, regions=[REGION], table={"AU4": {"grin": 1.0}})


def test_what_is_taken_for_what_is_drawn(trained):
    figure = plot_confusion(trained)
    (axes,) = [axes for axes in figure.axes if axes.get_visible()]
    counts = trained.models[0].confusion
    assert [t.get_text() for t in axes.texts] == [f"{count:,}" for count in counts.ravel() if count]
    assert [t.get_text() for t in axes.get_yticklabels()] == ["rest", *REGION.units]


def test_showings_before_the_film_are_refused():
    late = Lesson.of_spans([(0.95, 1.5, "AU4")], 30, 10.0, offset=1.0)  # half a frame is nothing
    assert np.flatnonzero(late.units == "AU4").tolist() == [0, 1, 2, 3, 4]
    with pytest.raises(InputError, match=r"Showing 1, of AU4 from 0\.5 to 1\.5 s, begins 0\.5 s before the film"):
        Lesson.of_spans([(0.5, 1.5, "AU4")], 30, 10.0, offset=1.0)
    with pytest.raises(InputError, match=r"from 3 to 5 s, ends after the lesson, which lasts until 4 s"):
        Lesson.of_spans([(3.0, 5.0, "AU4")], 30, 10.0, offset=1.0)


def test_showings_of_unknown_units_are_named(lesson, caplog):
    patches, shown, _ = lesson
    units = shown.units.astype(object)
    units[np.flatnonzero(units == "AU4")[:10]] = "AU99"
    train_classifier(patches, Lesson(units, shown.repetitions), regions=[REGION])
    assert "The showings of AU99 teach none of the units that are told" in caplog.text


def test_a_unit_without_a_place_in_the_table_is_named(trained, lesson):
    with pytest.raises(InputError, match="no entry for 'AU9'"):
        classify(trained, lesson[0], table={"AU1+2": {}, "AU4": {}})


def test_a_classifier_comes_back_from_its_file(trained, tmp_path):
    path = tmp_path / "model.npz"
    write_model(path, KIND, VERSION, *pack(trained))
    again = unpack(*read_model(path, KIND, VERSION))
    patches, _, _ = perform(repetitions=1, seed=8)
    for ours, theirs in zip(trained(patches), again(patches), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-6)
    assert again.units == trained.units and again.models[0].scores == trained.models[0].scores
    np.testing.assert_array_equal(again.models[0].confusion, trained.models[0].confusion)
    assert again.models[0].answers == trained.models[0].answers == ("rest", *REGION.units)


def test_damaged_classifiers_are_refused(trained, tmp_path):
    path = tmp_path / "model.npz"
    meta, arrays = pack(trained)
    write_model(path, "something else", VERSION, meta, arrays)
    with pytest.raises(InputError, match="holds no patch classifier"):
        read_model(path, KIND, VERSION)
    write_model(path, KIND, 99, meta, arrays)
    with pytest.raises(InputError, match=f"of version 99, but {VERSION} is read here"):
        read_model(path, KIND, VERSION)
    with pytest.raises(InputError, match="does not fit together"):
        unpack(meta, arrays | {"0:weights": arrays["0:weights"][:1]})
    with pytest.raises(InputError, match="does not fit together"):
        unpack(meta, arrays | {"0:scales": -arrays["0:scales"]})
    for wrong in (np.ones((3, 1)), np.full((3, 2), np.inf), np.full((3, 2), np.nan)):
        with pytest.raises(InputError, match="does not fit together"):
            unpack(meta, arrays | {"0:scales": wrong})
    wider = np.hstack([arrays["0:weights"], arrays["0:weights"][:, :1]])
    text, wrong_way = arrays["0:weights"].astype(str), arrays["0:coverage"][:, ::-1]
    for name, value in (("weights", wider), ("weights", text), ("coverage", wrong_way), ("errors", -np.ones(3))):
        with pytest.raises(InputError, match="does not fit together"):
            unpack(meta, arrays | {f"0:{name}": value})
    for picture in (np.zeros((3, 3, 3), np.uint8), np.full((44, 56), np.nan), np.zeros((1, 1), np.uint8)):
        with pytest.raises(InputError, match="does not fit together"):
            unpack(meta, arrays | {"neutral:forehead": picture})
    with pytest.raises(InputError, match="does not fit together"):
        unpack(meta, arrays | {"0:confusion": arrays["0:confusion"][:2]})
    with pytest.raises(InputError, match="damaged"):
        unpack(meta, {key: value for key, value in arrays.items() if key != "0:offsets"})
