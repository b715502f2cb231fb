"""The field's metrics: accuracy of reprojected segments, overlap on the field, errors in metres, compound score.

Accuracy reproduces SoccerNet's evaluation (`fieldcalib.metrics.accuracy`), the others follow the papers that introduced
them. Predictions are cameras, with any lens, or homographies from the field to the image.
"""

import lazy_loader

# The names are listed in __init__.pyi; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
