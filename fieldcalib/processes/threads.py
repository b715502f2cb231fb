"""Number of threads of libraries, which read it from the environment when they are imported."""

from __future__ import annotations

import os

# of the libraries that NumPy may use, and of OpenCV
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"), "1"
)


def one_thread_for_blas() -> None:
    """Let NumPy's BLAS use one thread, unless the user has said otherwise; to be called before NumPy is imported.

    The matrices here are too small to gain from more, and sums that are split among threads depend on their number.
    """
    for name, value in ONE_THREAD.items():
        if name != "OPENCV_FOR_THREADS_NUM":
            os.environ.setdefault(name, value)
