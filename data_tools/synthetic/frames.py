"""Labelled synthetic frames, one for each seed."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from data_tools.synthetic.cameras import is_behind_goal, random_camera
from data_tools.synthetic.degraded import degraded, random_picture
from data_tools.synthetic.games import Game, game_named
from data_tools.synthetic.hard import hard_game, random_shape
from data_tools.synthetic.masks import Mask, markings_mask
from data_tools.synthetic.pictures import add_graphics
from data_tools.synthetic.surroundings import GroundView
from fieldcalib._types import BoolArray
from fieldcalib.console.arguments import SOCCER
from fieldcalib.draw.scene import to_uint8
from fieldcalib.fields.field import Field
from fieldcalib.fields.traits import CameraDistribution
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.image_files import Image

SIZE = (512, 288)
EMPTY_SHARE = 0.05  # share of frames without a field
HARD_SHARE, HARD = 0.5, 1  # share of hard frames of soccer, and the stream of random numbers that tells them


@dataclass(frozen=True)
class SyntheticFrame:
    """A picture with the class of every pixel."""

    image: Image
    """(height, width, 3), blue, green, red."""
    mask: Mask
    """(height, width): 0 for the background, 1 + index in the game's classes (soccer's: `CLASSES`) for markings.

    Markings behind people and nets are marked: these hide few pixels of a curve that goes on on both sides, and the
    network is to learn to bridge such gaps. Markings behind graphics, boards or spectators in the foreground are
    background: nothing of them can be seen, often up to the image's border.
    """
    camera: Camera | None
    """Camera of the frame; None where there is no field."""
    field: Field

    @property
    def behind_goal(self) -> bool:
        """Whether the camera stands behind the left goal, not on the main side."""
        return self.camera is not None and is_behind_goal(self.camera, self.field)


def frame(seed: int, size: tuple[int, int] = SIZE, name: str = SOCCER) -> SyntheticFrame:
    """A frame of a random game, the same for the same seed.

    Parameters
    ----------
    seed : int
    size : (int, int)
        Width and height in pixels. Noise, blur and captions are made for sizes near the default.
    name : str
        Name of the field in `fieldcalib.fields.catalogue.FIELDS`, or a file with one (`fieldcalib.io.field_files`).

    Examples
    --------
    >>> made = frame(1)
    >>> made.image.shape, made.mask.shape, bool(made.mask.any())
    ((288, 512, 3), (288, 512), True)
    """
    rng, game = np.random.default_rng(seed), game_named(name)
    chance = np.random.default_rng((seed, HARD))
    hard = name == SOCCER and chance.random() < HARD_SHARE
    if hard:
        game = hard_game()
    field = game.random_field(rng)
    if rng.random() < EMPTY_SHARE:
        image = random_picture(size, rng)
        add_graphics(image, rng)
        return SyntheticFrame(degraded(image, rng), np.zeros(size[::-1], np.uint8), None, field)
    shape = random_shape(size, chance) if hard else size
    return seen_by(random_camera(field, shape, rng, game.stands), field, rng, game, size)


def seen_from(stand: CameraDistribution, seed: int, size: tuple[int, int] = SIZE) -> SyntheticFrame:
    """A hard frame of a soccer field of 105 x 68 m from one stand, in the shape of `size`.

    Examples
    --------
    >>> from data_tools.synthetic.hard import HIGH_BEHIND
    >>> seen_from(HIGH_BEHIND, 0).behind_goal
    True
    """
    rng, game = np.random.default_rng(seed), hard_game()
    camera = random_camera(game.field, size, rng, {stand: 1.0})
    return seen_by(camera, game.field, rng, game)


def seen_by(
    camera: Camera, field: Field, rng: np.random.Generator, game: Game, size: tuple[int, int] | None = None
) -> SyntheticFrame:
    """A frame of a random game as a given camera sees it; its size is the camera's, or it is squashed to `size`."""
    image, hidden = filmed(GroundView.of(camera), field, rng, game)
    if size is not None and size != camera.image_size:
        camera = camera.scaled(size)
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
        hidden = cv2.resize(hidden.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    mask = np.where(hidden, np.uint8(0), markings_mask(camera, field, game.classes))
    return SyntheticFrame(image, mask, camera, field)


def filmed(view: GroundView, field: Field, rng: np.random.Generator, game: Game) -> tuple[Image, BoolArray]:
    """Picture of a random game, and the mask of the pixels in which something hides the field."""
    light = game.light(view.ground, field, rng)
    picture = game.ground(view.ground, field, rng) * light
    hidden = game.surround(picture, view, field, rng)
    image = to_uint8(picture)
    game.add_objects(image, light, view.camera, field, rng)
    hidden |= add_graphics(image, rng)
    return degraded(image, rng), hidden
