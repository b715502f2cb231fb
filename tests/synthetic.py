"""Synthetic frames with known cameras: what a camera sees of an object, as labelled pixels."""

import numpy as np
from fieldcalib.problem.parameters import camera_from_theta, sample_theta

from fieldcalib.fields.segments import Line
from fieldcalib.fields.soccer import soccer
from fieldcalib.fields.stands import DISTRIBUTIONS

LENGTH_IN_VIEW = 10.0  # px: shorter lines have no direction


def observe(object_segments, camera, rng=None, noise=0.0, per_line=3, per_curve=9):
    """Labelled pixels of all segments in view, evenly spread over their visible part, with Gaussian noise in pixels."""
    width, height = camera.image_size
    frame = {}
    for label, segment in object_segments.items():
        xy = camera.project(segment.sample(0.25))
        inside = np.all((xy >= 0.0) & (xy <= (width - 1.0, height - 1.0)), axis=1)  # false for NaN
        xy = xy[inside]
        is_line = isinstance(segment, Line)
        if len(xy) < 2 or (is_line and np.linalg.norm(xy[-1] - xy[0]) < LENGTH_IN_VIEW):
            continue
        count = min(per_line if is_line else per_curve, len(xy))
        frame[label] = xy[np.linspace(0, len(xy) - 1, count).round().astype(int)]
        if noise:
            frame[label] = frame[label] + rng.normal(scale=noise, size=frame[label].shape)
    return frame


def whole_circle_markings(field):
    """The markings as annotators name them: the centre circle once, not in halves too."""
    return {label: s for label, s in field.markings.items() if not label.startswith("Circle central ")}


def frames_of_broadcasts(count, seed, noise=0.0, least_segments=5, names=tuple(DISTRIBUTIONS), image_size=(960, 540)):
    """`count` frames of random cameras, one distribution after the other: (frames, true thetas)."""
    rng, markings = np.random.default_rng(seed), whole_circle_markings(soccer())
    frames, thetas = [], []
    while len(frames) < count:
        theta = sample_theta(DISTRIBUTIONS[names[len(frames) % len(names)]], 1, rng, image_size)[0]
        frame = observe(markings, camera_from_theta(theta, image_size), rng, noise)
        if len(frame) >= least_segments:
            frames.append(frame)
            thetas.append(theta)
    return frames, np.array(thetas)
