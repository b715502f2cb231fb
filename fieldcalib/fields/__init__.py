"""Calibration objects: segments, fields with their sizes and symmetry, and where their cameras stand."""
