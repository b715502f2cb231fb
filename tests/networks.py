"""What a segmentation network would say of a known camera's image: blurred bands along the markings, and its faults."""

import cv2
import numpy as np
from pictures import KeptByCamera
from synthetic import whole_circle_markings

from fieldcalib.draw.scene import fixed_point, image_curves
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.images.background.keyframe_tracking import tied_frames
from fieldcalib.images.clip.keyframes import EXTRA_OFFSETS
from fieldcalib.localize import BACKGROUND

FIELD = soccer()
LABELS = tuple(whole_circle_markings(FIELD))
CLASSES = (BACKGROUND, *LABELS)
GRID = (320, 180)
BAND = 2.5  # px of the grid: width of what annotations are drawn with
OVERSAMPLED = 4
MOST_LOGIT = 6.0


def band_maps(camera, grid=GRID):
    """How much of each pixel of a grid lies on the band along each marking: (K, h, w), nothing for the background."""
    size = np.multiply(grid, OVERSAMPLED)
    maps = np.zeros((len(CLASSES), grid[1], grid[0]), np.float32)
    for band, label in zip(maps[1:], LABELS, strict=True):
        curves = [(xy + 0.5) * size / camera.image_size - 0.5 for xy in image_curves(camera, FIELD[label])]
        if curves:
            fine = np.zeros(size[::-1], np.uint8)
            thickness = round(BAND * OVERSAMPLED)
            cv2.polylines(fine, [fixed_point(curve) for curve in curves], False, 255, thickness, cv2.LINE_8, 4)
            share = cv2.resize(fine, grid, interpolation=cv2.INTER_AREA) / np.float32(255)
            band[:] = cv2.GaussianBlur(share, (0, 0), 0.6)
    return maps


def probabilities(maps, rng=None, noise=0.0):
    """Class probabilities (K, h, w) of band maps, with noise in the logits that neighbouring pixels share."""
    edge = 1.0 / (1.0 + np.exp(MOST_LOGIT))
    share = np.clip(maps, edge, 1.0 - edge)
    odds = share / (1.0 - share)
    odds[0] = 1.0
    if noise:
        for plane in odds:
            wave = cv2.GaussianBlur(rng.standard_normal(plane.shape, dtype=np.float32), (0, 0), 1.0)
            plane *= np.exp(noise * wave / wave.std())
    return odds / odds.sum(axis=0)


seen_by = KeptByCamera(lambda camera, grid: probabilities(band_maps(camera, grid)), most=16)  # of 6 MB each


class KnownCameras:
    """A network that sees what the given cameras see, one after the other."""

    classes = CLASSES

    def __init__(self, cameras, grid=GRID):
        self.maps = [seen_by(camera, grid) if camera else self.nothing(grid) for camera in cameras]

    def nothing(self, grid):
        maps = np.zeros((len(CLASSES), grid[1], grid[0]), np.float32)
        maps[0] = 1.0
        return maps

    def __call__(self, images):
        first, self.maps = self.maps[: len(images)], self.maps[len(images) :]
        return np.stack(first)


def looked_at(pictures, cameras=None, **how):
    """The frames of a video that `calibrate_video` shows its network, in order: more where this finds no camera."""
    found, told = [], set()
    for _, tied in tied_frames(pictures, **how):
        soon = cameras is not None and tied.piece not in told and tied.index - tied.key in EXTRA_OFFSETS
        if tied.is_key or not tied.ties or soon:
            found.append(tied.index)
            if cameras is not None and cameras[tied.index]:
                told.add(tied.piece)
    return found


class KnownPictures:
    """A network that recognises pictures, in any order and in any process, and sees what their cameras see."""

    classes = CLASSES

    def __init__(self, pictures, cameras, grid=GRID):
        self.small, self.cameras, self.grid = np.stack([self.reduced(one) for one in pictures]), cameras, grid

    def reduced(self, picture):
        return cv2.resize(picture, (32, 18), interpolation=cv2.INTER_AREA).astype(np.float32)

    def __call__(self, images):
        like = [np.argmin(np.abs(self.small - self.reduced(one)).sum(axis=(1, 2, 3))) for one in images]
        cameras = [self.cameras[k] for k in like]
        return np.stack(
            [seen_by(one, self.grid) if one else KnownCameras([None], self.grid).maps[0] for one in cameras]
        )


class Blind:
    """A network that sees nothing."""

    classes = CLASSES

    def __call__(self, images):
        return np.zeros((len(images), len(CLASSES), *GRID[::-1]), np.float32)
