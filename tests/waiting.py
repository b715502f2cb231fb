"""Waits for what other processes and threads do."""

import time


def wait_until(condition, seconds=120.0):
    """Wait until a function returns something true, which is returned; fail after so many seconds."""
    deadline = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < deadline, f"waited {seconds:.0f} s in vain"
        time.sleep(0.01)
    return found
