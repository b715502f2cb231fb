"""Degradation of synthetic frames as by a broadcast, and pictures that show no field."""

from __future__ import annotations

import cv2
import numpy as np

from data_tools.synthetic.colours import GREY, NOISE_SIZE, noise_tile, random_colour, vivid_colour
from fieldcalib._types import Float32
from fieldcalib.io.image_files import Image


def degraded(image: Image, rng: np.random.Generator) -> Image:
    """The image after lens, motion, sharpening, grading, noise and compression; nothing moves by more than a pixel."""
    height, width = image.shape[:2]
    picture = image.astype(np.float32)
    if rng.random() < 0.3:  # an old signal of low resolution, scaled up
        factor = rng.uniform(0.4, 0.85)
        small = cv2.resize(picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
        cv2.resize(small, (width, height), dst=picture, interpolation=cv2.INTER_LINEAR)
    if rng.random() < 0.25:
        cv2.filter2D(picture, -1, _motion(width, rng), dst=picture)
    if rng.random() < 0.4:
        cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.3, 1.0), dst=picture)
    if rng.random() < 0.4:  # broadcasters sharpen: bright lines get dark rims
        picture += rng.uniform(0.2, 1.0) * (picture - cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.7, 1.5)))
    picture = _graded(picture, rng)
    if rng.random() < 0.6:
        picture += rng.uniform(0.5, 6.0) * _grain(picture.shape, rng)
    result: Image = np.clip(picture + 0.5, 0.0, 255.0).astype(np.uint8)
    if rng.random() < 0.7:
        compressed = cv2.imencode(".jpg", result, [cv2.IMWRITE_JPEG_QUALITY, int(rng.uniform(25.0, 95.0))])[1]
        return np.asarray(cv2.imdecode(compressed, cv2.IMREAD_COLOR), np.uint8)
    return result


def random_picture(size: tuple[int, int], rng: np.random.Generator) -> Image:
    """A picture without a field: plain grass, a crowd, a studio or graphics, with lines that are no markings."""
    width, height = size
    corners = np.array([[vivid_colour(rng) for _ in range(2)] for _ in range(2)], np.float32)
    if rng.random() < 0.4:
        corners[:] = random_colour(rng, (70.0, 130.0), (0.4, 0.9), (0.25, 0.7))
    picture = np.asarray(cv2.resize(corners, size, interpolation=cv2.INTER_LINEAR), np.float32)
    zoom = rng.uniform(1.0, 4.0) * max(1.0, width / NOISE_SIZE)
    tile = np.asarray(cv2.resize(noise_tile(), None, fx=zoom, fy=zoom), np.float32)
    picture += rng.uniform(0.0, 40.0) * tile[:height, :width, None]
    if rng.random() < 0.4:  # a crowd, out of focus or not
        seats = (int(rng.integers(20, 120)), int(rng.integers(12, 70)))
        crowd = rng.integers(0, 256, size=(*seats[::-1], 3)).astype(np.float32)
        rows = int(rng.uniform(0.3, 1.0) * height)
        picture[:rows] = cv2.resize(crowd, size, interpolation=cv2.INTER_LINEAR)[:rows]
    image = np.clip(picture, 0.0, 255.0).astype(np.uint8)
    for _ in range(rng.integers(0, 12)):
        a, b = (rng.uniform(-0.2, 1.2, size=(2, 2)) * size).astype(int).tolist()
        kind, colour, thickness = rng.integers(3), vivid_colour(rng), int(rng.integers(1, 5))
        if kind == 0:
            cv2.line(image, a, b, colour, thickness, cv2.LINE_AA)
        elif kind == 1:
            cv2.rectangle(image, a, b, colour, cv2.FILLED if rng.random() < 0.5 else thickness)
        else:
            axes = (abs(a[0] - b[0]) // 2 + 1, abs(a[1] - b[1]) // 2 + 1)
            cv2.ellipse(image, a, axes, rng.uniform(0.0, 180.0), 0.0, 360.0, colour, -1 if rng.random() < 0.7 else 2)
    if rng.random() < 0.5:  # a face or a player close up
        x, y = int(rng.uniform(0.2, 0.8) * width), int(rng.uniform(0.3, 0.5) * height)
        cv2.ellipse(image, (x, height), (width // 6, height // 2), 0.0, 0.0, 360.0, vivid_colour(rng), cv2.FILLED)
        cv2.ellipse(image, (x, y), (width // 14, height // 6), 0.0, 0.0, 360.0, (110, 145, 200), cv2.FILLED)
    if rng.random() < 0.6:
        cv2.GaussianBlur(image, (0, 0), rng.uniform(0.5, 4.0), dst=image)
    return image


def _motion(width: int, rng: np.random.Generator) -> Float32:
    """The kernel of a camera that pans while its shutter is open, for images of this width."""
    length, angle = rng.uniform(1.0, 6.0) * width / 512.0, rng.normal(0.0, 0.3)
    middle = int(np.ceil(length / 2.0))
    kernel = np.zeros((2 * middle + 1, 2 * middle + 1), np.float32)
    for s in np.linspace(-0.5, 0.5, 8 * middle + 4):
        x, y = np.rint(middle + s * length * np.array([np.cos(angle), np.sin(angle)])).astype(int)
        kernel[y, x] += 1.0
    return np.asarray(kernel / kernel.sum())


def _graded(picture: Float32, rng: np.random.Generator) -> Float32:
    """The picture with random exposure, contrast, colour and vignetting."""
    height, width = picture.shape[:2]
    grey = (picture @ GREY)[..., None]
    picture = np.asarray(grey + rng.uniform(0.5, 1.35) * (picture - grey), np.float32)
    balance = np.exp(rng.normal(0.0, 0.06, size=3)) * rng.uniform(0.9, 1.6)
    picture *= balance.astype(np.float32)
    picture += rng.uniform(-15.0, 35.0) if rng.random() < 0.4 else 0.0  # haze, or crushed blacks
    if rng.random() < 0.5:
        across, down = (np.square(np.linspace(-1.0, 1.0, n, dtype=np.float32)) for n in (width, height))
        picture *= (1.0 - rng.uniform(0.0, 0.2) * (across + down[:, None]))[..., None]
    if rng.random() < 0.5:
        gamma = rng.uniform(0.7, 1.4)
        table = 255.0 * np.linspace(0.0, 1.0, 256, dtype=np.float32) ** gamma
        return np.asarray(cv2.LUT(np.clip(picture, 0.0, 255.0).astype(np.uint8), table), np.float32)
    return picture


def _grain(shape: tuple[int, ...], rng: np.random.Generator) -> Float32:
    """Sensor noise with standard deviation 1, often grey."""
    height, width, channels = shape
    grain = rng.standard_normal((height, width, 1 if rng.random() < 0.5 else channels), dtype=np.float32)
    return np.asarray(grain)
