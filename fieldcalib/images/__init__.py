"""From images to cameras: line profiles, refinement on the image, hypotheses; matches between frames."""
