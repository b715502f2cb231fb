from . import jobs as jobs
from . import other_process as other_process
from . import threads as threads
