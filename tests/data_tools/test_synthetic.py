"""data_tools.synthetic: frames come from their seeds, and masks are where the markings are, on the right side."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from data_tools.synthetic import CLASSES, frame, mirrored_values
from data_tools.synthetic.__main__ import main
from data_tools.synthetic.cache import read_frame, write_cache
from data_tools.synthetic.cameras import is_behind_goal, on_canonical_side, random_camera, random_field
from data_tools.synthetic.degraded import random_picture
from data_tools.synthetic.hard import other_lines, sunlight
from data_tools.synthetic.masks import markings_mask
from data_tools.synthetic.surroundings import GroundView
from fieldcalib.fields.field import BEHIND_MARGIN
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera

SIZE = (512, 288)
SEEDS = range(18)


@pytest.fixture(scope="module")
def frames():
    return [frame(seed) for seed in SEEDS]


@pytest.fixture(scope="module")
def hard_frames():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("data_tools.synthetic.frames.HARD_SHARE", 1.0)
        patch.setattr("data_tools.synthetic.frames.EMPTY_SHARE", 0.0)
        return [frame(seed) for seed in range(100, 114)]


@pytest.fixture(scope="module")
def frames_with_field(frames):
    return [one for one in frames if one.camera is not None]


def test_classes_are_those_that_soccernet_annotates():
    assert len(CLASSES) == 26
    assert list(CLASSES) == sorted(CLASSES)
    assert set(soccer().markings) - set(CLASSES) == {"Circle central left", "Circle central right"}


def test_a_frame_is_a_function_of_its_seed(frames):
    again = frame(SEEDS[3])
    assert np.array_equal(again.image, frames[3].image)
    assert np.array_equal(again.mask, frames[3].mask)
    assert again.camera == frames[3].camera
    assert len({one.image.tobytes() for one in frames}) == len(frames)


def test_other_sizes():
    made = frame(1, (256, 144))
    assert made.image.shape == (144, 256, 3)
    assert made.mask.shape == (144, 256)
    assert made.camera.image_size == (256, 144)


def test_frames_without_a_field_have_no_markings(frames):
    empty = [one for one in frames if one.camera is None]
    assert 0 < len(empty) < 0.2 * len(frames)
    assert not any(one.mask.any() for one in empty)
    assert not any(one.behind_goal for one in empty)


def test_marked_pixels_lie_on_the_projected_markings(frames_with_field):
    distances = []
    for one in frames_with_field[:15]:
        for value in np.unique(one.mask[one.mask > 0]):
            curve = one.camera.project(one.field[CLASSES[value - 1]].sample(spacing=0.002))
            curve = curve[np.all(np.abs(curve) < 1e4, axis=1)]
            y, x = np.nonzero(one.mask == value)
            distances.append(cKDTree(curve).query(np.column_stack([x, y]))[0])
    assert np.mean(np.concatenate(distances)) < 1.0
    assert np.max(np.concatenate(distances)) < 3.0  # the diagonal of 3 px by 3 around pixels that were rounded


def test_projected_markings_are_marked(frames_with_field):
    for one in frames_with_field[:15]:
        whole = markings_mask(one.camera, one.field)
        for label in CLASSES:
            xy = one.camera.project(one.field[label].sample(spacing=0.5))
            x, y = np.rint(xy[np.all((xy >= 0.0) & (xy <= np.array(SIZE) - 1.0), axis=1)]).astype(int).T
            assert np.all(whole[y, x] > 0)


def test_what_is_marked_is_painted(frames_with_field):
    # On average over all frames, markings are lighter than the ground 6 px above and below them.
    differences = []
    for one in frames_with_field:
        grey = one.image.astype(float).mean(axis=-1)
        y, x = np.nonzero(one.mask[6:-6])
        differences.append(np.mean(grey[y + 6, x] - 0.5 * (grey[y, x] + grey[y + 12, x])))
    assert np.mean(differences) > 8.0
    assert np.mean(np.array(differences) > 0.0) > 0.85


# the side


@pytest.mark.parametrize(
    ("C", "turned"),
    [
        ((10.0, 60.0, -15.0), False),
        ((10.0, -60.0, -15.0), True),
        ((-70.0, -10.0, -15.0), False),
        ((70.0, 10.0, -15.0), True),
        ((70.0, 34.0 + BEHIND_MARGIN + 0.1, -15.0), False),  # beside the corner: the main side
        ((70.0, 34.0 + BEHIND_MARGIN - 0.1, -15.0), True),
        ((-70.0, -34.0 - BEHIND_MARGIN - 0.1, -15.0), True),
    ],
)
def test_cameras_are_turned_to_the_side_that_the_labels_follow(C, turned):
    camera = Camera.from_angles(0.3, 1.2, 0.01, 700.0, C, SIZE)
    side = on_canonical_side(camera, soccer())
    assert (side.C[0] == -C[0]) == turned
    assert on_canonical_side(side, soccer()) == side
    X = np.random.default_rng(0).uniform(-20.0, 20.0, size=(50, 3))
    turn = (-1.0, -1.0, 1.0) if turned else (1.0, 1.0, 1.0)
    assert np.allclose(side.project(X * turn), camera.project(X), equal_nan=True)


def test_random_cameras_are_on_that_side():
    rng = np.random.default_rng(0)
    behind = 0
    for _ in range(60):
        field = random_field(rng)
        assert 90.0 <= field.length <= 120.0
        assert 45.0 <= field.width <= 90.0
        camera = random_camera(field, SIZE, rng)
        assert camera == on_canonical_side(camera, field)
        behind += is_behind_goal(camera, field)
    assert 0 < behind < 30


@pytest.mark.parametrize(("C", "pan", "axis"), [((-8.0, 70.0, -17.0), -0.2, 0), ((-75.0, 6.0, -15.0), 1.5, 1)])
def test_a_mirrored_image_is_that_of_the_mirrored_field(C, pan, axis):
    camera = Camera.from_angles(pan, 1.3, 0.0, 500.0, C, SIZE, principal_point=(250.0, 140.0))
    mirror = np.ones(3)
    mirror[axis] = -1.0
    K = camera.K.copy()
    K[0, 2] = SIZE[0] - 1.0 - K[0, 2]
    mirrored = Camera(K, np.diag([-1.0, 1.0, 1.0]) @ camera.R @ np.diag(mirror), camera.C * mirror, SIZE)
    mask, other = markings_mask(camera, soccer()), markings_mask(mirrored, soccer())
    assert mask.any()
    values = mirrored_values(behind_goal=axis == 1)
    assert np.mean(values[mask[:, ::-1]] == other) > 0.995  # but for the rounding of thick lines


def test_mirroring_twice_changes_nothing():
    for behind_goal in (False, True):
        values = mirrored_values(behind_goal=behind_goal)
        assert sorted(values) == list(range(27))
        assert np.array_equal(values[values], np.arange(27))


# files


def test_cached_frames_are_the_frames(tmp_path, frames):
    write_cache(tmp_path, SEEDS[:3], processes=1)
    paths = sorted(tmp_path.glob("*.jpg"))
    assert len(paths) == 3
    for path, one in zip(paths, frames, strict=False):
        image, mask, behind_goal = read_frame(path)
        assert np.array_equal(mask, one.mask)
        assert behind_goal == one.behind_goal
        assert np.mean(np.abs(image.astype(float) - one.image)) < 8.0
    written = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    write_cache(tmp_path, SEEDS[:3], processes=1)
    assert written == {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}


def test_the_contact_sheet(tmp_path, monkeypatch):
    monkeypatch.setattr("data_tools.synthetic.__main__.ROWS", 1)
    assert main(["--sheet", str(tmp_path / "sheet.png")]) == 0
    assert (tmp_path / "sheet.png").stat().st_size > 10000


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (3, 19))])
def test_frames_may_be_larger_than_those_of_training(seed):
    """The first shows no field, the others are blurred by motion, which grows with the width."""
    made = frame(seed, (1280, 720))
    assert (made.camera is None) == (seed == 0)
    assert made.image.shape == (720, 1280, 3)
    assert made.mask.shape == (720, 1280)


def test_pictures_without_a_field_may_be_larger_than_their_noise():
    rng = np.random.default_rng(0)
    for _ in range(5):
        assert random_picture((2560, 720), rng).shape == (720, 2560, 3)


# hard frames


@pytest.mark.slow
def test_the_other_half_of_the_frames_is_what_it_was(monkeypatch):
    """Whether a frame is hard is told by numbers of their own."""
    made = [frame(seed) for seed in SEEDS]
    monkeypatch.setattr("data_tools.synthetic.frames.HARD_SHARE", 0.0)
    same = [np.array_equal(one.image, frame(seed).image) for seed, one in zip(SEEDS, made, strict=True)]
    assert 0.25 < np.mean(same) < 0.75


def test_hard_frames_have_the_size_of_others_whatever_their_shape(hard_frames):
    aspects = set()
    for one in hard_frames:
        assert one.image.shape == (SIZE[1], SIZE[0], 3)
        assert one.camera.image_size == SIZE
        fx, fy = one.camera.K[0, 0], one.camera.K[1, 1]
        aspects.add(round(float(fx / fy), 1))
    assert len(aspects) > 3


def test_hard_frames_are_seen_from_above_and_from_behind(hard_frames):
    assert 0.05 < np.mean([one.behind_goal for one in hard_frames]) < 0.6
    tilts = [np.degrees(np.arccos(one.camera.R[2, 2])) for one in hard_frames]
    assert min(tilts) < 40.0
    assert max(tilts) > 80.0


@pytest.mark.parametrize("seed", range(6))
def test_sun_and_shadow_have_sharp_edges(seed):
    view = GroundView.of(Camera.from_angles(0.0, 1.2, 0.0, 420.0, (0.0, 60.0, -25.0), SIZE))
    light = sunlight(view.ground, soccer(), np.random.default_rng(seed))
    assert light.shape == (3, SIZE[1], SIZE[0])
    assert np.all(np.isfinite(light))
    assert np.all(light > 0.0)


def test_most_hard_frames_have_strong_shadows():
    view = GroundView.of(Camera.from_angles(0.0, 1.2, 0.0, 420.0, (0.0, 60.0, -25.0), SIZE))
    lights = [sunlight(view.ground, soccer(), np.random.default_rng(seed))[1] for seed in range(40)]
    jumps = [np.max(np.abs(np.diff(np.log(light), axis=0))) for light in lights]
    assert np.mean(np.array(jumps) > 0.15) > 0.4


def test_lines_of_other_sports_are_painted_on_the_ground():
    view = GroundView.of(Camera.from_angles(0.0, 1.0, 0.0, 420.0, (0.0, 50.0, -40.0), SIZE))
    picture = np.zeros((3, SIZE[1], SIZE[0]), np.float32)
    other_lines(picture, view.ground, np.random.default_rng(0))
    painted = picture.max(axis=0) > 20.0
    assert 0.002 < painted.mean() < 0.3


@pytest.mark.parametrize(("pan", "up", "behind"), [(0.0, -1.0, False), (0.5 * np.pi, 1.0, True), (np.pi, -1.0, False)])
def test_what_is_up_in_a_picture_from_above_tells_the_side(pan, up, behind):
    """Labels are those of a picture whose upper edge is the far touchline, or the goal far away."""
    camera = on_canonical_side(Camera.from_angles(pan, 0.2, 0.0, 420.0, (0.0, -3.0, -60.0), SIZE), soccer())
    assert is_behind_goal(camera, soccer()) == behind
    above, below = camera.image_to_field(np.array([[256.0, 40.0], [256.0, 248.0]]))
    axis = 0 if behind else 1
    assert np.sign(above[axis] - below[axis]) == up
    assert on_canonical_side(camera, soccer()) == camera
