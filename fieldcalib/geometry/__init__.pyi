from . import camera as camera
from . import homography as homography
from . import image_extent as image_extent
from . import lens as lens
from . import projective as projective
from . import rational as rational
from . import rotation as rotation
