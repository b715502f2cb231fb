"""Players in pictures: they are told from ground, lines and boards, and do not count as background."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fieldcalib.images.background.matches import match_background
from fieldcalib.images.background.matching_frame import Frame, blobs_on_ground, thumbnail
from fieldcalib.io.image_files import Image

GRASS, WOOD = (60, 140, 60), (110, 170, 210)
SIZE = (320, 180)


def ground(colour: tuple[int, int, int] = GRASS) -> Image:
    """A plain thumbnail."""
    return np.full((SIZE[1], SIZE[0], 3), colour, np.uint8)


@pytest.mark.parametrize("colour", [GRASS, WOOD])
@given(
    x=st.integers(20, 290),
    y=st.integers(20, 140),
    width=st.integers(5, 12),
    ratio=st.floats(1.2, 3.0),
    shirt=st.sampled_from([(30, 30, 200), (255, 255, 255), (20, 20, 20), (200, 60, 20)]),
)
def test_players_are_found_on_any_ground(
    colour: tuple[int, int, int], x: int, y: int, width: int, ratio: float, shirt: tuple[int, int, int]
) -> None:
    image = ground(colour)
    image[y : y + round(ratio * width), x : x + width] = shirt
    blobs = blobs_on_ground(image)
    assert blobs[y + width // 2, x + width // 2]
    assert np.count_nonzero(blobs) < 6 * width * width + 200  # and a margin


@given(angle=st.floats(0.0, np.pi), thickness=st.integers(1, 5))
def test_hardly_any_of_a_line_is_a_player(angle: float, thickness: int) -> None:
    image = ground()
    along = 140.0 * np.array([np.cos(angle), np.sin(angle)])
    ends = [tuple(np.rint(np.array(SIZE) / 2.0 + sign * along).astype(int).tolist()) for sign in (-1, 1)]
    cv2.line(image, ends[0], ends[1], (255, 255, 255), thickness, cv2.LINE_AA)
    on_line = np.any(image != GRASS, axis=2)
    assert np.mean(blobs_on_ground(image)[on_line]) < 0.2  # where a slanting line is thicker by a pixel


def test_letters_on_boards_and_other_floors_are_no_players() -> None:
    image = ground()
    image[:60] = (120, 30, 30)  # boards
    image[20:36, 100:110] = 255
    image[120:, 200:] = (150, 90, 30)  # a floor of another colour
    assert not blobs_on_ground(image).any()


def test_thumbnails_keep_small_pictures() -> None:
    small = np.zeros((40, 60, 3), np.uint8)
    assert thumbnail(small).shape == small.shape
    assert thumbnail(np.zeros((1080, 1920, 3), np.uint8)).shape == (180, 320, 3)


def pitch_with_runners(shift: tuple[float, float], run: float) -> Image:
    """Faint blurred grass that moves by `shift`, and players with sharp shirts who run by `run` pixels beside it."""
    rng = np.random.default_rng(0)
    noise = cv2.resize(rng.normal(0.0, 30.0, (34, 60)), (960, 540), interpolation=cv2.INTER_CUBIC)
    grass = np.clip(np.array(GRASS) + noise[..., None], 0, 255).astype(np.uint8)
    moved = cv2.warpAffine(
        grass, np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]]), (960, 540), borderMode=cv2.BORDER_REFLECT
    )
    for _ in range(40):
        x, y = rng.uniform((40.0, 40.0), (880.0, 440.0))
        shirt = cv2.resize(rng.integers(0, 255, (10, 4, 3), np.uint8), (20, 50), interpolation=cv2.INTER_NEAREST)
        x0, y0 = round(x + shift[0] + run), round(y + shift[1])
        moved[y0 : y0 + 50, x0 : x0 + 20] = shirt
    return moved


def test_players_who_run_together_are_no_background() -> None:
    first, second = pitch_with_runners((0.0, 0.0), 0.0), pitch_with_runners((9.0, -4.0), 4.0)
    found = match_background(first, second)
    in_grey = match_background(*(cv2.cvtColor(one, cv2.COLOR_BGR2GRAY) for one in (first, second)))
    assert found is not None
    assert in_grey is not None
    np.testing.assert_allclose(np.median(found.second - found.first, axis=0), (9.0, -4.0), atol=0.3)
    assert np.median(in_grey.second - in_grey.first, axis=0)[0] > 12.0  # the runners, who cannot be told without colour


def test_players_are_followed_where_nothing_else_has_corners() -> None:
    images = [ground(), ground()]
    rng = np.random.default_rng(1)
    for x in range(30, 290, 20):
        for y in range(30, 150, 30):
            shirt = rng.integers(0, 255, (14, 7, 3), np.uint8)
            for k, image in enumerate(images):
                image[y - 2 * k : y + 14 - 2 * k, x + 3 * k : x + 7 + 3 * k] = shirt
    first, second = (cv2.resize(one, (1280, 720), interpolation=cv2.INTER_CUBIC) for one in images)
    np.testing.assert_array_equal(Frame.of(first).corners, Frame.of(cv2.cvtColor(first, cv2.COLOR_BGR2GRAY)).corners)
    found = match_background(first, second)
    assert found is not None
    np.testing.assert_allclose(np.median(found.second - found.first, axis=0), (12.0, -8.0), atol=0.5)
