from .network import Network as Network
from .network import SegmentationNetwork as SegmentationNetwork
from .network import localize as localize
from .point_selection import BACKGROUND as BACKGROUND
from .point_selection import Localization as Localization
from .point_selection import ridge_points as ridge_points
from .point_selection import skeleton_points as skeleton_points
