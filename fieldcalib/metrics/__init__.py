"""The field's metrics: accuracy of reprojected segments, overlap on the field, errors in metres, compound score.

Accuracy reproduces SoccerNet's evaluation (`fieldcalib.metrics.accuracy`), the others follow the papers that introduced
them. Predictions are cameras, with any lens, or homographies from the field to the image.
"""

from fieldcalib.metrics.accuracy import THRESHOLDS, Confusion, SegmentEvaluation, evaluate_segments
from fieldcalib.metrics.distance import ProjectionError, projection_error
from fieldcalib.metrics.overlap import iou_part, iou_whole
from fieldcalib.metrics.scores import compound_score
from fieldcalib.metrics.views import Prediction

__all__ = [
    "THRESHOLDS",
    "Confusion",
    "Prediction",
    "ProjectionError",
    "SegmentEvaluation",
    "compound_score",
    "evaluate_segments",
    "iou_part",
    "iou_whole",
    "projection_error",
]
