"""The lens: the map from the ideal pinhole image to the real, distorted one.

Coordinates are isotropic offsets from the principal point in pixels, ``s = f (X/Z, Y/Z)``, and the coefficients are
normalised to the corner of the image. With rho half its diagonal, ``u = s / rho`` and ``q = |u|^2``, the lenses

    Pinhole             distorted = s
    RadialLens          distorted = s (1 + a1 q + a2 q^2)
    BrownConradyLens    distorted = s (1 + a1 q + a2 q^2 + a3 q^3) / (1 + a4 q + a5 q^2 + a6 q^3)
                                  + rho (2 p1 ux uy + p2 (q + 2 ux^2) + s1 q + s2 q^2,
                                         p1 (q + 2 uy^2) + 2 p2 ux uy + s3 q + s4 q^2)

are OpenCV's lens (documentation of calib3d, "Detailed Description") with ``dist_coeffs = (k1, k2, p1, p2, k3, ...)``:
``a1 = k1 (rho / f)^2``, ``a2 = k2 (rho / f)^4`` and so on (`POWERS`). So a1 + a2 is the relative displacement of the
corner at any zoom, and a lens is a warp of the image that does not depend on f.

Where the slope ``1 + 3 a1 q + 5 a2 q^2`` is negative, the lens is not monotone: the image folds back, and lines far
outside the image are projected into it, in every program that uses the lens. With ``a2 >= 9/20 a1^2`` for barrel
distortion (a1 < 0) and ``a2 >= 0`` for pincushion distortion the slope is positive at every radius. The estimated
parameters are therefore (a1, b2), ``a2 = b2 + FOLD min(a1, 0)^2`` with b2 >= 0: at a1 = -1 % the term moves the corner
of an image by 0.005 %.

`FisheyeLens` is OpenCV's other lens, that of ``cv2.fisheye``. It bends angles, and is therefore the one lens whose warp
depends on f.

Arrays have their components first: plane vectors are (2, ...), coefficients are (n, ...) and broadcast against the
trailing axes of the points. Contiguous components halve the time.

A new lens is a file with a subclass of `Lens`, and a line in `LENSES`.
"""

from __future__ import annotations

from collections.abc import Collection

from numpy.typing import ArrayLike

from fieldcalib.geometry.lens.brown_conrady import BrownConradyLens as BrownConradyLens
from fieldcalib.geometry.lens.fisheye import FisheyeLens as FisheyeLens
from fieldcalib.geometry.lens.model import Lens as Lens
from fieldcalib.geometry.lens.model import nonzero_coefficients
from fieldcalib.geometry.lens.pinhole import Pinhole as Pinhole
from fieldcalib.geometry.lens.radial import RadialLens as RadialLens

__all__: list[str] = []  # what Tab shows: nothing here is for users

LENSES: dict[str, type[Lens]] = {lens.name: lens for lens in (Pinhole, RadialLens, BrownConradyLens, FisheyeLens)}


def __dir__() -> list[str]:
    return __all__.copy()


def lens_with(coefficients: Collection[str], rho: float) -> Lens:
    """The smallest lens that has some of OpenCV's coefficients, given by their names; a fisheye has others.

    Examples
    --------
    >>> lens_with({"k1", "p2"}, rho=550.0)
    BrownConradyLens(rho=550.0)
    """
    fitting = (one for one in LENSES.values() if set(coefficients) <= set(one.opencv_names) and not one.follows_zoom)
    return min(fitting, key=lambda lens: len(lens.names))(rho)


def lens_of(dist_coeffs: ArrayLike | None, rho: float) -> Lens:
    """The smallest lens that has all of OpenCV's distortion coefficients that are not 0.

    Raises
    ------
    ValueError
        As in `fieldcalib.geometry.lens.model.opencv_vector`.

    Examples
    --------
    >>> lens_of([0.1, 0.0, 0.0, 0.0, 0.0], rho=550.0)
    RadialLens(rho=550.0)
    """
    return lens_with(nonzero_coefficients(dist_coeffs), rho)


def common_lens(lenses: Collection[Lens]) -> Lens:
    """The smallest lens that has the coefficients of all of some lenses of images of one size.

    Raises
    ------
    ValueError
        If some are fisheye lenses and others are not.

    Examples
    --------
    >>> common_lens([RadialLens(550.0), Pinhole(550.0)])
    RadialLens(rho=550.0)
    """
    (rho,) = {lens.rho for lens in lenses}
    are_fisheye = {isinstance(lens, FisheyeLens) for lens in lenses}
    if are_fisheye == {True, False}:
        raise ValueError("some of the cameras have a fisheye lens, and others have not: take them apart")
    if are_fisheye == {True}:
        return FisheyeLens(rho)
    return lens_with({name for lens in lenses for name in lens.opencv_names}, rho)
