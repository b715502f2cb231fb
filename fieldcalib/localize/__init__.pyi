from .batches import Network as Network
from .batches import localize as localize
from .network import SegmentationNetwork as SegmentationNetwork
from .network_grid import BACKGROUND as BACKGROUND
from .network_grid import Localization as Localization
from .point_selection import ridge_points as ridge_points
from .point_selection import skeleton_points as skeleton_points
