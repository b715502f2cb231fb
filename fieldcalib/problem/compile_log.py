"""Log message while Numba compiles, to explain why the first calibration after an installation takes long."""

import logging
from typing import Any

from numba.core import event

LOG = logging.getLogger(__name__)
COMPILING = (
    "compiling the solver with Numba, which may take half a minute: once after an installation, it is kept for later"
)


class _CompilationListener(event.Listener):
    """Listens for the first function of one module that is not in Numba's cache."""

    def __init__(self, module: str) -> None:
        self.module = module
        self.done = False

    def on_start(self, event: Any) -> None:
        if not self.done and event.data["dispatcher"].py_func.__module__ == self.module:
            self.done = True
            LOG.info(COMPILING)

    def on_end(self, event: Any) -> None:
        """Ignore the end of a compilation."""


def log_compilation(module: str) -> None:
    """Log once, as information, when the first function of a module is about to be compiled."""
    event.register("numba:compile", _CompilationListener(module))
