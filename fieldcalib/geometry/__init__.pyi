from .camera import Camera as Camera
from .homography import ALIGNMENTS as ALIGNMENTS
from .homography import Alignment as Alignment
