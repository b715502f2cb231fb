"""Starting cameras: from where a camera distribution stands, pointed at the labels; and from lines by the DLT."""

from __future__ import annotations

import numpy as np

from fieldcalib._types import Array
from fieldcalib.parameters import ANGLES, CENTER, LOG_F, CameraDistribution
from fieldcalib.segments import Observations
from fieldcalib.rotation import rotation_from_angles
from fieldcalib.parameters import PRINCIPAL_POINT, GaussianPrior


def pointed(observations: Observations, prior: GaussianPrior) -> Array:
    """Cameras at the prior's mean position, turned and zoomed so that the middles of the labelled segments come to lie near the labelled pixels."""
    X, xy, weight = [], [], []
    for rows in (observations.lines, observations.arcs):
        if not rows:
            continue
        if rows is observations.lines:
            X.append(rows.geometry[:, :, 0] + 0.5 * rows.geometry[:, :, 1])
            size = np.linalg.norm(rows.geometry[:, :, 1], axis=-1)
        else:
            X.append(rows.geometry[:, :, 0])
            size = 2 * np.linalg.norm(rows.geometry[:, :, 1], axis=-1)
        xy.append(rows.xy)
        weight.append(rows.weight / (size + 5.0) ** 2)
    X, xy, w = np.concatenate(X, 1), np.concatenate(xy, 1), np.concatenate(weight, 1)
    w /= w.sum(1, keepdims=True)
    T = len(w)
    C = prior.mean[CENTER]
    target = np.sum(w[..., None] * X, 1)
    pixel = np.sum(w[..., None] * xy, 1)
    d = target - C
    theta = np.tile(prior.mean, (T, 1))
    pan = np.arctan2(d[:, 0], -d[:, 1])
    tilt = np.arctan2(np.hypot(d[:, 0], d[:, 1]), d[:, 2])
    theta[:, 0], theta[:, 1], theta[:, 2] = pan, tilt, 0
    Xc = (X - C) @ np.swapaxes(rotation_from_angles(theta[:, ANGLES]), 1, 2)
    x = Xc[..., :2] / np.maximum(Xc[..., 2:], 1.0)
    spread = np.sqrt(np.sum(w * np.sum(np.square(x), -1), 1))
    spread_px = np.sqrt(np.sum(w * np.sum(np.square(xy - pixel[:, None]), -1), 1))
    lo, hi = prior.mean[LOG_F] - 1.96 * prior.sigma[LOG_F], prior.mean[LOG_F] + 1.96 * prior.sigma[LOG_F]
    logf = np.clip(np.log((spread_px + 1) / (spread + 1e-3)), lo, hi)
    theta[:, LOG_F] = logf
    f = np.exp(logf)
    off = pixel - prior.mean[PRINCIPAL_POINT]
    theta[:, 0] -= np.arctan(off[:, 0] / f) / np.maximum(np.sin(theta[:, 1]), 0.3)
    theta[:, 1] += np.arctan(off[:, 1] / f)
    return theta
