from .collection import Results as Results
from .entry import calibrate as calibrate
from .entry import calibrate_rig as calibrate_rig
from .entry import read as read
