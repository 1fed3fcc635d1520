"""The mannequin's 140 shapes: each in its place, parts that sum to wholes, muscles that follow anatomy."""

import subprocess
import sys

import igl
import numpy as np
import pytest

from blendcap import mannequin
from blendcap.data import triangulate
from blendcap.data.facs import SHAPE_NAMES, SHAPES
from blendcap.synthetic.mannequin import MEASURES
from blendcap.synthetic.mannequin.cage import head_cage
from blendcap.synthetic.mannequin.contact import along_bone
from blendcap.synthetic.mannequin.face import Face
from blendcap.synthetic.mannequin.identity import make_person, measures_of
from blendcap.synthetic.mannequin.lips import smile
from blendcap.synthetic.mannequin.shared import shared
from faces import alone, person, reflected, skin_normals

REACH = {  # regions that may move by more than 0.5 mm
    "brow": {"brows", "forehead", "glabella", "lids", "nose", "sockets", "scalp", "cheeks"},
    "eye": {"lids", "eyes", "sockets", "cheeks", "brows", "nose", "glabella", "forehead"},
    "lid": {"lids", "sockets"},
    "blink": {"lids", "sockets", "cheeks", "brows"},
    "mouth": {"lips", "cheeks", "jaw", "nose", "mouth", "lids", "neck", "scalp"},
    "smile": {"lips", "cheeks", "jaw", "nose", "mouth", "lids", "neck"},
    "viseme": {"lips", "cheeks", "jaw", "nose", "mouth", "lids", "neck", "teeth", "tongue", "scalp"},
    "jaw": {"lips", "cheeks", "jaw", "neck", "mouth", "teeth", "tongue", "scalp", "nose"},
    "chin": {"lips", "jaw", "mouth", "cheeks"},
    "neck": {"neck", "jaw", "cheeks", "lips", "scalp"},
    "nos": {"nose", "lips", "cheeks", "lids", "mouth", "glabella", "brows", "forehead"},  # nose, nostril
    "nasolabial": {"lips", "cheeks", "nose", "mouth"},
    "cheek": {"cheeks", "lips", "lids", "nose", "jaw", "brows", "mouth", "sockets", "neck", "scalp"},
    "tongue": {"tongue", "lips", "mouth", "jaw", "nose", "cheeks"},
}


@pytest.mark.parametrize("name", SHAPE_NAMES)
def test_each_shape_moves_its_own_part_of_the_face(name):
    rig = person()
    moved = np.linalg.norm(rig.deltas[rig.index(name)], axis=1)
    assert 0.8 < moved.max() < 45
    kind = next(prefix for prefix in REACH if name.startswith(prefix))
    single = [region for region in rig.regions if region not in ("upper", "lower")]
    reached = {region for region in single if moved[rig.regions[region]].max() > 0.5}
    assert reached <= REACH[kind]


def test_no_two_shapes_are_the_same():
    rig = person()
    flat = rig.deltas.reshape(len(rig.names), -1).astype(np.float64)
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    cosine = flat @ flat.T - np.eye(len(flat))
    first, second = np.unravel_index(cosine.argmax(), cosine.shape)
    assert cosine.max() < 0.995, (rig.names[first], rig.names[second])


@pytest.mark.parametrize("whole", sorted({shape.arkit for shape in SHAPES if shape.arkit not in ("", shape.name)}))
def test_parts_sum_to_the_whole(whole):
    rig = person(3)
    parts = [shape.name for shape in SHAPES if shape.arkit == whole and shape.name != whole]
    assert len(parts) in (2, 4)
    total = rig.deltas[[rig.index(name) for name in parts]].sum(0)
    assert np.abs(total - rig.deltas[rig.index(whole)]).max() < 1e-4


def test_halves_overlap_only_near_the_midline():
    rig = person()
    left, right = (rig.deltas[rig.index(f"mouthSmile{side}")] for side in ("Left", "Right"))
    whole = left + right
    far = np.abs(rig.mesh.vertices[:, 0]) > 25
    larger = np.where(np.linalg.norm(left, axis=1)[:, None] > np.linalg.norm(right, axis=1)[:, None], left, right)
    assert np.abs(whole - larger)[far].max() < 0.02


def test_gaze_turns_the_eye_the_way_it_says():
    rig = person()
    eyes = rig.regions["eyes"]
    left = eyes[rig.mesh.vertices[eyes, 0] > 0]
    cornea = left[rig.mesh.vertices[left, 2].argmax()]
    for name, axis, sign in (("In", 0, -1), ("Out", 0, 1), ("Up", 1, 1), ("Down", 1, -1)):
        moved = rig.deltas[rig.index(f"eyeLook{name}Left"), cornea]
        assert sign * moved[axis] > 4
        assert np.abs(rig.deltas[rig.index(f"eyeLook{name}Right")][left]).max() == 0


def test_the_jaw_takes_its_teeth_along_as_one_piece():
    rig = person()
    teeth = rig.regions["teeth"]
    rest = rig.mesh.vertices[teeth]
    half = len(teeth) // 2
    down = rig.deltas[rig.index("jawOpen")][teeth]
    assert (down[:half] == 0).all()  # upper
    assert (down[half:, 1] < -5).all()
    before, after = (np.linalg.norm(p[half:] - p[half], axis=1) for p in (rest, rest + down))
    assert np.abs(after - before).max() < 1e-4


@pytest.mark.parametrize("identity", [0, "kofi", 9])
def test_a_sneer_wrinkles_the_root_of_the_nose(identity):
    rig = person(identity)
    marks = rig.points["landmarks68"]
    _, moved = rig.select(("noseSneerLeft", "noseSneerRight")).sample(marks)
    both = moved.sum(0)
    assert (both[[21, 22], 1] < -1).all()  # the inner ends of the brows sink
    assert both[28, 1] > 0.5 and both[[31, 35], 1].min() > 2  # bridge and wings of the nose rise
    assert np.abs(both[[36, 45, 48, 54]]).max() < 0.6  # corners of eyes and mouth keep still


def test_shapes_mirror():
    rig, twins = person(), shared().surface.twins
    deltas = rig.deltas[:, : len(twins)]
    assert np.array_equal(deltas[rig.mirror][:, twins], reflected(deltas).astype(np.float32))


@pytest.mark.parametrize("identity", [0, "kofi", "lars", "mei"])
def test_no_quad_turns_over(identity):
    rig = person(identity)
    rest = skin_normals(rig.mesh.vertices)
    for name in rig.names:
        turned = (skin_normals(rig.pose(alone(rig, name))) * rest).sum(1) < 0
        assert not turned.any(), name


def _corner(identity, shape: str) -> np.ndarray:
    """How far a shape moves the left corner of the mouth of somebody, mm."""
    rig = mannequin(identity)
    corner = int(head_cage().index(["seam.4"])[0])
    return rig.deltas[rig.index(shape), corner]


def test_shapes_depend_on_the_person():
    """Longer muscles move further: wide cheekbones, wide jaws, high lips; and the plain person lies between."""
    for measure, axis, shape in (("bizygomatic_width", 0, "mouthSmileLeft"), ("bigonial_width", 0, "mouthStretchLeft")):
        limit = 1.9 * MEASURES[measure].deviation
        less, same, more = (abs(_corner({measure: value}, shape)[axis]) for value in (-limit, 0, limit))
        assert less < same < more, measure
        assert more > 1.02 * less, measure
    thick, thin = ({f"{lip}_lip_height": 2.8 * sign for lip in ("upper", "lower")} for sign in (1, -1))
    rolled = [np.linalg.norm(mannequin(who).deltas[SHAPE_NAMES.index("mouthRollUpper")], axis=1).max()
              for who in (thin, thick)]  # fmt: skip
    assert rolled[1] > 1.15 * rolled[0]


def test_wide_faces_smile_wide():
    """Among people drawn by seed, the smile's reach goes with the length of the muscle that makes it."""
    cage, reach, width = head_cage(), [], []
    for seed in range(1, 41):
        face = Face(cage, make_person(cage, measures_of(seed)))
        reach.append(smile(face)[cage.index(["seam.4"])[0], 0])
        width.append(face.at("P7")[0] + face.at("R9")[0] - 2 * face.at("seam.4")[0])
    assert np.corrcoef(reach, width)[0, 1] > 0.8
    assert max(reach) > 1.15 * min(reach)


def test_skin_slides_along_the_bone():
    """A sheet of skin that is drawn up the forehead ends on the resting skin, where a straight step leaves it."""
    cage, surface = head_cage(), shared().surface
    face = Face(cage, make_person(cage, {}))
    skin = np.ascontiguousarray(surface.through(cage.mirrored(face.points)))
    left = triangulate(surface.quads[: len(surface.quads) // 2])
    at = cage.index(["b2", "b3", "b4", "H3", "H4"])
    straight = np.zeros((1, len(face.points), 3))
    normal = face.normals[at]
    straight[0, at] = 12 * (np.array([0, 1, 0]) - normal * normal[:, 1:2])
    ends = [face.points[at] + moved[0, at] for moved in (straight, along_bone(face, straight, skin, left))]
    chord, slid = (np.sqrt(igl.point_mesh_squared_distance(np.ascontiguousarray(p), skin, left)[0]) for p in ends)
    resting = np.sqrt(igl.point_mesh_squared_distance(np.ascontiguousarray(face.points[at]), skin, left)[0])
    assert chord.max() > 1.0
    assert (slid <= resting + 1e-6).all()


def test_it_is_the_same_in_another_process():
    code = (
        "import hashlib, numpy as np; from blendcap import mannequin; rig = mannequin(7); "
        "parts = np.round(rig.deltas, 3).tobytes() + np.round(rig.mesh.vertices, 6).tobytes(); "
        "print(hashlib.sha256(parts).hexdigest())"
    )
    run = [subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True) for _ in range(2)]
    assert run[0].stdout == run[1].stdout and len(run[0].stdout) == 65
