"""Synthetic clips of soccer with true cameras: paths of cameras, the pictures of a stadium, and samples to try."""
