"""Geometry without fields: rotations, projective maps, the lens, the camera, homographies."""
