"""Rendered pictures of known cameras, each drawn once in a process: drawing takes much of the time of a test."""

from collections import OrderedDict

import numpy as np

from fieldcalib.draw.scene import render_field
from fieldcalib.fields.sports.soccer import soccer

FIELD = soccer()
MOST = 40  # pictures that are kept, of 1.5 MB each


class KeptByCamera:
    """Arrays that a function makes of a camera and of anything that can be hashed; they cannot be changed in place."""

    def __init__(self, function, most):
        self.function, self.most, self.kept = function, most, OrderedDict()

    def __call__(self, camera, *others):
        values = (camera.K, camera.R, camera.C, camera.dist)
        key = *(value.tobytes() for value in values), camera.image_size, *others
        if key not in self.kept:
            self.kept[key] = self.function(camera, *others)
            self.kept[key].setflags(write=False)
            while len(self.kept) > self.most:
                self.kept.popitem(last=False)
        self.kept.move_to_end(key)
        return self.kept[key]


def _rendered(camera, field, seed):
    return render_field(camera, field, rng=None if seed is None else np.random.default_rng(seed))


_kept = KeptByCamera(_rendered, MOST)


def picture(camera, field=FIELD, seed=0):
    """`render_field` with the noise of a seed, or without noise where that is None."""
    return _kept(camera, field, seed).copy()
