from .jobs import Processes as Processes
from .jobs import in_order as in_order
