"""From labelled pixels, points or homographies to cameras."""
