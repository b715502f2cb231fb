"""Labelled frames of synthetic games, as many as wanted, to train a network that segments the markings of a field.

python -m data_tools.synthetic --sheet OUT.png      a contact sheet
python -m data_tools.synthetic --cache DIR          frames for data_tools.train
python -m data_tools.synthetic --out DIR            the same with true cameras and annotations
python -m data_tools.synthetic --bench              frames per second
python -m data_tools.synthetic --clip OUT.mp4       a clip with its true cameras
python -m data_tools.synthetic --samples DIR        the clip and the picture of fieldcalib.sample

Frames are of soccer, or of any field with --field NAME or --field FILE; clips are of soccer.
"""

from data_tools.synthetic.frames import SIZE, SyntheticFrame, frame
from data_tools.synthetic.masks import CLASSES, Mask, mirrored_values

__all__ = ["CLASSES", "SIZE", "Mask", "SyntheticFrame", "frame", "mirrored_values"]
