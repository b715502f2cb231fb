"""Clips cut out of a panorama of noise: their motion is known, and no field is seen."""

import cv2
import numpy as np

SIZE = (640, 360)


def panorama(seed):
    """Blobs of several sizes, twice as wide as the picture."""
    rng = np.random.default_rng(seed)
    layers = [rng.normal(size=(800 // s, 1400 // s)).astype(np.float32) for s in (6, 18, 54)]
    scene = sum(cv2.resize(layer, (1400, 800), interpolation=cv2.INTER_CUBIC) for layer in layers)
    return np.clip(128.0 + 40.0 * scene, 0, 255).astype(np.uint8)


def K(f):
    return np.array([[f, 0.0, 319.5], [0.0, f, 179.5], [0.0, 0.0, 1.0]])


def homography(pan, zoom):
    """From frame 0 to one that pans by so many degrees and zooms, K2 R K1^-1."""
    return K(zoom * 900.0) @ cv2.Rodrigues(np.radians([0.0, pan, 0.0]))[0] @ np.linalg.inv(K(900.0))


def motions(count, pan=0.1, zoom=1.002):
    return [homography(pan * i, zoom**i) for i in range(count)]


def shot(count, seed=0, pan=0.1, zoom=1.002):
    """Frames of a camera that pans by so many degrees per frame and zooms, with noise."""
    scene, rng = panorama(seed), np.random.default_rng(seed)
    middle = np.array([[1.0, 0.0, -380.0], [0.0, 1.0, -220.0], [0.0, 0.0, 1.0]])
    pictures = [cv2.warpPerspective(scene, H @ middle, SIZE, flags=cv2.INTER_LINEAR) for H in motions(count, pan, zoom)]
    return [np.clip(p + rng.normal(scale=2.0, size=p.shape), 0, 255).astype(np.uint8) for p in pictures]


def dissolved(one, other, count):
    weights = np.arange(1, count + 1) / (count + 1.0)
    mixed = [cv2.addWeighted(a, 1.0 - w, b, w, 0.0) for a, b, w in zip(one[-count:], other, weights, strict=False)]
    return [*one[:-count], *mixed, *other[count:]]
