"""Pictures that may be enlarged parts of frames (digital zoom): evidence for it, and cameras with free principal point.

An enlarged part has the shape of a frame, but its principal point may lie anywhere, and the labels often hardly
determine it (`fieldcalib.assess.cropping_evidence`). It also has less detail than its size allows, as enlarging makes
no fine detail. Whole frames may be as soft, if they were enlarged as a whole or are out of focus. So detail counts only
together with the labels: a camera is doubted if it would be wrong with the principal point elsewhere, and the softer
the picture, the sooner. It is then fitted once more with a principal point that may lie anywhere, and that camera is
taken if its errors, which include those of the principal point, are small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fieldcalib._types import Float32
from fieldcalib.assess.cropping_evidence import ENLARGED, SURE, PrincipalPointEvidence, score
from fieldcalib.assess.findings import Verdict
from fieldcalib.assess.result import Calibration, with_findings
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.images.paint.field_markings import Markings
from fieldcalib.images.paint.line_profiles import LUMA
from fieldcalib.images.refinement import ToRefine, refine_all
from fieldcalib.images.shape.borders_and_squash import Method
from fieldcalib.io.image import Image
from fieldcalib.problem.prior import is_whole_shape
from fieldcalib.solve.request import Task
from fieldcalib.solve.solver_options import Prior, checked_prior

WINDOW_SHARE = 0.15  # of the width: standard deviation of the principal point in a window that was cut out and enlarged
PIECE, EVERY = 64, 4  # px: length of the pieces whose spectrum is taken; one row and one column in four is used
COARSE, FINE = slice(4, 9), slice(17, 24)  # bands of the spectrum, of 32 up to Nyquist's frequency
MOST_STRUCTURE = 0.95  # quantile of the power in the coarse band: edges above it tell how much detail there is
FAINT = 0.5  # power, levels squared, added to keep the logarithm finite
# Softness grows from 0 at a `detail` of SHARP downwards. Of 199 broadcast pictures with a good camera 85 % have more
# detail than -4.7, of enlarged parts of them 4 %.
SHARP, LARGEST_SOFTNESS = -4.2, 0.9
SOFTEST = -6.9  # few enlarged parts have less; pictures of 256 x 256 stretched to 1280 x 720 have -6.3 to -8.1
SCORE_OF_SOFTNESS = 5.0  # score of a softness of 1, in the units of `fieldcalib.assess.cropping_evidence.score`
LEAST_SCORE = 1.0  # score of softness and labels together above which a picture may be an enlarged part


def with_enlarged_parts(calibrate: Method, images: Sequence[Image], *, task: Task) -> list[Calibration]:
    """Calibrate pictures; if one may be an enlarged part of a frame, its principal point is freed or a doubt added."""
    markings = Markings.of(task.object_segments)
    return [
        _as_enlarged(task, markings, image, one) if may_be_enlarged(image, one) else one
        for image, one in zip(images, calibrate(images), strict=True)
    ]


def may_be_enlarged(image: Image, calibration: Calibration) -> bool:
    """Whether a picture may be an enlarged part of a frame, so that its otherwise good camera may be wrong."""
    camera, solved = calibration.camera, calibration.solved
    if camera is None or solved is None or calibration.verdict is not Verdict.GOOD:
        return False
    if not (calibration.has_probability and is_whole_shape(camera.image_size)):
        return False
    uncertainty = solved.on(calibration.field)
    evidence = PrincipalPointEvidence.of(uncertainty)
    if evidence is None or uncertainty.layout.image_size != camera.image_size:
        return False
    missing = LEAST_SCORE - score(uncertainty, evidence, calibration.probability(size_known=True))
    return missing < SCORE_OF_SOFTNESS * LARGEST_SOFTNESS and SCORE_OF_SOFTNESS * softness(image) > missing


def softness(image: Image) -> float:
    """Lack of fine detail in a picture compared with usual ones, from 0 for sharp pictures to 0.9.

    It is 0 again for pictures softer than enlarged parts of frames: these are small pictures enlarged as a whole.

    Examples
    --------
    >>> import cv2
    >>> noise = np.random.default_rng(0).integers(0, 255, (540, 960, 3), dtype=np.uint8)
    >>> frame = cv2.GaussianBlur(noise, (0, 0), 0.7)
    >>> softness(frame), softness(cv2.resize(frame[:270, :480], (960, 540)))
    (0.0, 0.9)
    """
    found = detail(image)
    return 0.0 if found < SOFTEST else float(np.clip(SHARP - found, 0.0, LARGEST_SOFTNESS))


def detail(image: Image) -> float:
    """Log ratio of the power of fine and of coarse detail at the edges of a picture, along rows or columns.

    Pictures that were squashed or interlaced are soft in one direction, enlarged ones in both; the larger ratio counts.
    """
    return max(_detail_along_rows(some @ LUMA) for some in (image[::EVERY], image[:, ::EVERY].swapaxes(0, 1)))


def _detail_along_rows(brightness: Float32) -> float:
    width = brightness.shape[1] // PIECE * PIECE
    pieces = brightness[:, :width].reshape(-1, PIECE)
    if not len(pieces):
        return 0.0
    window = np.hanning(PIECE).astype(np.float32)
    power = np.square(np.abs(np.fft.rfft((pieces - pieces.mean(axis=1, keepdims=True)) * window, axis=1)))
    coarse, fine = (np.mean(power[:, band], axis=1) for band in (COARSE, FINE))
    edges = coarse >= np.quantile(coarse, MOST_STRUCTURE)
    return float(np.median(np.log((fine[edges] + FAINT) / (coarse[edges] + FAINT))))


def _as_enlarged(task: Task, markings: Markings, image: Image, calibration: Calibration) -> Calibration:
    """Take the camera with a free principal point if it is sure, else add a doubt to the calibration."""
    freed = _freed(task, markings, image, calibration)
    if freed is not None and freed.verdict is Verdict.GOOD and freed.probability(level=True) >= SURE:
        x, y = freed.required_camera.principal_point
        found = f"the picture may be an enlarged part of a frame: its principal point was found at ({x:.0f}, {y:.0f})"
        return replace(freed, message=f"{found}; {freed.message}")
    return with_findings(calibration, ENLARGED)


def _freed(task: Task, markings: Markings, image: Image, calibration: Calibration) -> Calibration | None:
    """Refine a calibration with a principal point that may lie anywhere; None if that gives no camera."""
    camera, solved = calibration.required_camera, calibration.solved
    assert solved is not None
    if calibration.field is not None and calibration.field is not task.field:  # of another size
        task = replace(task, object_segments=calibration.field)
        markings = Markings.of(calibration.field)
    task = replace(task, prior=window_prior(task.prior, task.object_segments, camera.image_size))
    given = ToRefine(image, calibration, solved.pixels, are_detected=True)
    (refined,) = refine_all(task, markings, [given], quick=True)
    return None if refined.calibration is calibration else refined.judged


def window_prior(prior: Prior, object_segments: ObjectSegments, image_size: tuple[int, int]) -> Prior:
    """Widen the prior of the principal point for pictures that are parts, moving or still, of larger ones.

    A window with the shape of a whole frame was cut out and enlarged, so its principal point may lie far off. For
    narrower pictures the prior allows for that already (`fieldcalib.problem.prior`).

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> window_prior("main center", soccer(), (960, 540))[0].principal_point
    0.15
    """
    if prior is None or not is_whole_shape(image_size):
        return prior
    stands = checked_prior(prior, object_segments if isinstance(object_segments, Field) else None)
    return tuple(replace(one, principal_point=max(one.principal_point, WINDOW_SHARE)) for one in stands)
