"""Search for the homography of an edge image: the nearest cameras of the database, and their refinement."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from baselines.chen.database import Database
from baselines.chen.edges import EDGE_SIZE, Edges, edge_images, scaling
from baselines.chen.refinement import HALF_SIZE, Step, mismatch, refined
from fieldcalib._types import Array

RETRIEVAL_TRUNCATION, CHOICE_TRUNCATION = 12.5, 5.0  # largest distances, pixels of EDGE_SIZE


@dataclass(frozen=True)
class Recipe:
    """Options of the search."""

    nearest: int
    """Number of cameras with the nearest features; their distance images are compared with the edge image's."""
    refined: int
    """Number of the most similar of these, which are refined; the result is the one most similar afterwards."""
    steps: tuple[Step, ...]
    """Steps of the refinement."""


PUBLISHED = Recipe(1, 1, (Step(EDGE_SIZE, 12.5, cv2.MOTION_HOMOGRAPHY, 50),))
"""Chen and Little's recipe: the nearest camera, aligned once with distances up to 50 px of 1280 x 720."""

WIDER = Recipe(
    20,
    3,
    (
        Step(HALF_SIZE, 25.0, cv2.MOTION_AFFINE, 50),
        Step(HALF_SIZE, 12.5, cv2.MOTION_HOMOGRAPHY, 50),
        Step(EDGE_SIZE, 5.0, cv2.MOTION_HOMOGRAPHY, 20),
    ),
)
"""Our recipe: several cameras, each aligned with ever smaller distances and a new distance image at each step. More
frames converge, and the lines fit better."""


def homography(database: Database, edges: Edges, image_size: tuple[int, int], recipe: Recipe = WIDER) -> Array | None:
    """Find the homography of an edge image; None where it shows no line.

    Parameters
    ----------
    database : Database
        A database of the field that the edge image shows.
    edges : (180, 320) uint8 array
    image_size : (int, int)
        Width and height of the image in pixels.
    recipe : Recipe

    Returns
    -------
    (3, 3) array or None
        Maps field points (x, y, 1) in metres to pixels of the image.
    """
    if not np.any(edges):
        return None
    found = refined(retrieved(database, edges, recipe), edges, database.pieces, recipe.steps)
    best = np.argmin(mismatch(edge_images(found, database.pieces), edges, CHOICE_TRUNCATION)) if len(found) > 1 else 0
    return np.asarray(scaling(image_size) @ found[best])


def retrieved(database: Database, edges: Edges, recipe: Recipe = WIDER) -> Array:
    """Homographies (K, 3, 3) of the cameras whose views are most similar to the edge image, the most similar first."""
    (feature,) = database.extract(edges[None])
    H = database.cameras[database.nearest(feature, recipe.nearest)].homographies
    if recipe.nearest == 1:
        return H
    alike = mismatch(edge_images(H, database.pieces, HALF_SIZE), edges, RETRIEVAL_TRUNCATION)
    return np.asarray(H[np.argsort(alike, kind="stable")[: recipe.refined]])
