"""Cameras in the formats of other tools, one module each.

Every module has a function of named cameras, in the order of the frames, that gives the files of the format: a mapping
of names to contents. None stands for a frame without camera.
"""
