"""Matches of the background of a textured scene whose motion is known, with players and graphics."""

import cv2
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from strategies import examples
from views import camera

from fieldcalib.draw.scene import render_field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.images.background.background_motion import Motion, _rotation, _turn
from fieldcalib.images.background.matches import match_background, match_far
from fieldcalib.images.background.matching_frame import Frame, same_picture

SIZE = (1280, 720)
SCOREBOARD = (slice(40, 110), slice(80, 420))


def texture(seed=0, size=(2600, 1500)):
    """Blobs of several sizes, as wide as the picture twice, so that a turned camera sees no border."""
    rng = np.random.default_rng(seed)
    scales = (8, 24, 72)
    layers = [rng.normal(size=(size[1] // s, size[0] // s)).astype(np.float32) for s in scales]
    scene = sum(cv2.resize(layer, size, interpolation=cv2.INTER_CUBIC) for layer in layers)
    return np.clip(128.0 + 40.0 * scene, 0, 255).astype(np.uint8)


SCENE = texture()
MIDDLE = np.array([[1.0, 0.0, -660.0], [0.0, 1.0, -390.0], [0.0, 0.0, 1.0]])  # of the scene's pixels, to the picture


def K(f):
    return np.array([[f, 0.0, 639.5], [0.0, f, 359.5], [0.0, 0.0, 1.0]])


def homography(pan=0.0, tilt=0.0, roll=0.0, zoom=1.0, f=1800.0):
    """K2 R K1^-1 of angles in degrees."""
    R = cv2.Rodrigues(np.radians([tilt, pan, roll]))[0]
    return K(zoom * f) @ R @ np.linalg.inv(K(f))


def mapped(H, xy):
    return cv2.perspectiveTransform(xy[None], H)[0]


def view(H=None, scene=SCENE, noise=2.0, seed=1):
    """The scene as a camera sees it after the motion H, with noise."""
    picture = cv2.warpPerspective(scene, (np.eye(3) if H is None else H) @ MIDDLE, SIZE, flags=cv2.INTER_LINEAR)
    grain = np.random.default_rng(seed).normal(scale=noise, size=picture.shape)
    return np.clip(picture + grain, 0, 255).astype(np.uint8)


def errors(matches, H):
    return np.linalg.norm(mapped(H, matches.first) - matches.second, axis=1)


motions = st.fixed_dictionaries(
    {
        "pan": st.floats(-3.0, 3.0),
        "tilt": st.floats(-2.0, 2.0),
        "roll": st.floats(-1.0, 1.0),
        "zoom": st.floats(0.93, 1.07),
        "f": st.floats(1000.0, 4000.0),
    }
)
FIRST = Frame.of(view(seed=0))


@examples(15)
@given(motions)
@example({})
@example({"pan": 0.03, "f": 1800.0})
def test_matches_follow_a_turn_and_a_zoom(motion):
    H = homography(**motion)
    matches = match_background(FIRST, view(H), start=homography(**(motion | {"pan": motion.get("pan", 0.0) + 0.1})))
    assert np.median(errors(matches, H)) < 0.3
    assert np.percentile(errors(matches, H), 99) < 2.0
    assert matches.scale < 0.4
    assert matches.share > 0.8
    corners = np.array([[200.0, 150.0], [1080.0, 150.0], [1080.0, 570.0], [200.0, 570.0]])
    assert np.max(np.linalg.norm(mapped(matches.homography, corners) - mapped(H, corners), axis=1)) < 2.0


@pytest.mark.parametrize("turn", [(0.02, 0.1, 0.01), (0.0, 0.0, 0.0), (-0.05, 0.3, -0.02)], ids=str)
def test_jacobian_of_the_motion(turn):
    """Against central differences; that by the focal length is exact to second order of the turn, 6e-4 without it."""
    motion = Motion(np.array(turn), 1.3, 0.1, 0.03)
    p, q = np.random.default_rng(0).uniform(-0.7, 0.7, size=(2, 2, 50))
    J = motion.residuals(p, q)[1]

    def moved(step):
        s = np.exp(-step[3])  # pan and tilt times focal length stay
        turned = _turn(_rotation(step[:3]) @ _rotation(motion.turn * (s, s, 1.0)))
        other = Motion(turned, motion.log_f + step[3], motion.log_zoom + step[4], motion.lens + step[5])
        return other.residuals(p, q)[0]

    for i, tolerance in enumerate((1e-7, 1e-7, 1e-7, 5e-4 * np.linalg.norm(turn) + 1e-7, 1e-7, 1e-7)):
        h = 1e-6 * np.eye(6)[i]
        np.testing.assert_allclose(J[i], (moved(-h) - moved(h)) / 2e-6, atol=tolerance, err_msg=str(i))


def test_without_a_start_a_tenth_of_the_width_is_bridged():
    H = homography(pan=4.0)  # 126 px
    assert np.median(errors(match_background(FIRST, view(H)), H)) < 0.3


@pytest.mark.parametrize("motion", [{"pan": 14.0}, {"pan": -10.0, "zoom": 1.5}, {"tilt": 4.0, "zoom": 0.6}], ids=str)
def test_far_matches(motion):
    H = homography(**motion)
    second = Frame.of(view(H))
    assert match_background(FIRST, second) is None
    matches = match_far(FIRST, second)
    assert np.median(errors(matches, H)) < 0.3
    assert np.percentile(errors(matches, H), 95) < 1.5


@pytest.mark.parametrize("match", [match_background, match_far])
def test_the_other_way_round_it_is_the_inverse(match):
    second = Frame.of(view(homography(pan=1.0, tilt=0.4, zoom=1.02)))
    there, back = match(FIRST, second), match(second, FIRST)
    assert np.median(errors(there, np.linalg.inv(back.homography))) < 0.3
    same = there.reversed()
    np.testing.assert_allclose(mapped(same.homography, mapped(there.homography, there.first)), there.first, atol=1e-6)
    np.testing.assert_array_equal(same.first, there.second)


def with_players(picture, shift):
    """Twelve textured players, who all run the same way, and a scoreboard that stands still."""
    rng = np.random.default_rng(7)
    picture = picture.copy()
    boxes = []
    for i in range(12):
        x, y = 150 + 90 * i, 200 + 37 * (i * 5 % 11)
        player = cv2.resize(rng.integers(0, 255, (15, 6), dtype=np.uint8), (36, 90), interpolation=cv2.INTER_CUBIC)
        boxes.append((x + shift[0], y + shift[1]))
        picture[y + shift[1] : y + shift[1] + 90, x + shift[0] : x + shift[0] + 36] = player
    board = cv2.resize(rng.integers(0, 255, (10, 49), dtype=np.uint8), (340, 70), interpolation=cv2.INTER_NEAREST)
    picture[SCOREBOARD] = board
    return picture, np.array(boxes)


@pytest.mark.parametrize("pan", [0.3, 1.5, 4.0])
def test_players_and_a_scoreboard_have_no_matches(pan):
    H = homography(pan=pan)
    first, boxes = with_players(view(seed=0), (0, 0))
    second, _ = with_players(view(H), (round(np.radians(pan) * 900.0), 6))  # half as fast as the background
    matches = match_background(first, second)
    x, y = matches.first.T
    on_player = np.any([(x > a) & (x < a + 36) & (y > b) & (y < b + 90) for a, b in boxes], axis=0)
    rows, columns = SCOREBOARD
    on_board = (y > rows.start) & (y < rows.stop) & (x > columns.start) & (x < columns.stop)
    assert np.sum(on_player) <= 2
    assert np.sum(on_board) == 0
    assert np.median(errors(matches, H)) < 0.3


@pytest.mark.parametrize("opacity", [0.3, 0.6])
def test_half_transparent_graphics_hold_no_match_back(opacity):
    """What is seen through a graphic may be matched, the graphic not."""
    H = homography(pan=1.0, tilt=0.3)
    rng = np.random.default_rng(2)
    logo = cv2.resize(rng.integers(0, 255, (18, 32), dtype=np.uint8), SIZE, interpolation=cv2.INTER_NEAREST)
    pictures = [view(seed=0), view(H)]
    for picture in pictures:
        part = picture[:, 900:]
        part[:] = cv2.addWeighted(part, 1.0 - opacity, np.ascontiguousarray(logo[:, 900:]), opacity, 0.0)
    matches = match_background(*pictures)
    assert np.max(errors(matches, H)) < 4.0  # the graphic moves by 33 px against the background
    assert np.median(errors(matches, H)) < 0.3


def test_a_start_that_is_no_turn_gives_none():
    mirror = np.diag([-1.0, 1.0, 1.0])
    assert match_background(FIRST, FIRST, start=mirror) is None
    assert match_background(FIRST, FIRST, start=homography(zoom=20.0)) is None


def test_a_scoreboard_alone_is_no_background():
    blank = np.full(SIZE[::-1], 90, np.uint8)
    board = blank.copy()
    board[SCOREBOARD] = with_players(blank, (0, 0))[0][SCOREBOARD]
    assert match_background(board, board) is None
    assert match_far(board, board) is None


def blank(seed):
    return np.full((*SIZE[::-1], 3), 90, np.uint8)


def noise(seed):
    return np.random.default_rng(seed).integers(0, 255, (*SIZE[::-1], 3), dtype=np.uint8)


def scene(seed):
    return view(scene=texture(seed))


@pytest.mark.parametrize("kind", [blank, noise, scene])
@pytest.mark.parametrize("match", [match_background, match_far])
def test_honest_failure(match, kind):
    """Nothing to follow, noise, and a cut to another scene."""
    assert match(kind(3), kind(4)) is None


def test_a_wipe_is_no_match_of_the_whole():
    first, second = view(), view(scene=texture(9))
    second[:, :120] = first[:, :120]
    assert match_background(first, second) is None


def test_rendered_pitch_with_a_lens():
    """A lens with 6 % distortion in the corner: matches are where the two cameras see the same direction."""
    cameras = [camera(pan, 78, 1400, (0, 68, -17), k=(0.5, 0.0)) for pan in (20, 22)]
    first, second = (render_field(c, soccer(), rng=np.random.default_rng(5)) for c in cameras)
    matches = match_background(first, second)
    s = cameras[0].normalized(matches.first)
    X = cameras[0].C + 50.0 * np.column_stack([s, np.ones(len(s))]) @ cameras[0].R
    assert np.median(np.linalg.norm(cameras[1].project(X) - matches.second, axis=1)) < 0.3


def test_duplicates():
    first = view(seed=0)
    again = match_background(first, first + (first % 8 == 3))  # the same picture, compressed anew
    assert again.duplicate
    np.testing.assert_allclose(again.first, again.second, atol=0.3)
    assert not match_background(first, view(homography(pan=0.05))).duplicate
    assert not same_picture(first, with_players(first, (0, 0))[0])


def test_sizes_scale():
    """A picture twice as large has matches at twice the pixels: pixel centres are at integers."""
    H = homography(pan=1.0)
    large = [cv2.resize(view(h, noise=0.0), (2560, 1440), interpolation=cv2.INTER_LINEAR) for h in (None, H)]
    matches = match_background(*large)
    first, second = ((z + 0.5) / 2.0 - 0.5 for z in (matches.first, matches.second))
    assert np.median(np.linalg.norm(mapped(H, first) - second, axis=1)) < 0.3


def test_colour_is_grey_and_frames_are_pictures():
    H = homography(pan=1.0)
    grey = match_background(FIRST, view(H))
    colour = match_background(view(seed=0), cv2.cvtColor(view(H), cv2.COLOR_GRAY2BGR))
    np.testing.assert_allclose(grey.second, colour.second, atol=0.1)


@pytest.mark.parametrize(
    ("second", "message"),
    [
        (np.zeros((540, 960, 3), np.uint8), "of one size"),
        (np.zeros((720, 1280)), "uint8"),
        (np.zeros((720, 1280, 4), np.uint8), "shape"),
        (None, "uint8"),
    ],
    ids=["size", "float", "alpha", "none"],
)
def test_wrong_pictures(second, message):
    with pytest.raises(ValueError, match=message):
        match_background(FIRST, second)


def test_wrong_start():
    with pytest.raises(ValueError, match=r"start: expected a homography, .*\(3, 3\)"):
        match_background(FIRST, FIRST, start=np.eye(2))


@pytest.mark.parametrize("shape", [(1, 1), (3, 2000), (20, 30), (2160, 3840)])
def test_any_size_of_picture(shape):
    assert match_background(np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)) is None
    assert match_far(np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)) is None
