"""Temporary files of killed processes are removed by the next one that writes there, those of living ones are not."""

import signal
import subprocess
import sys

import pytest
from waiting import wait_until

from fieldcalib._whole_files import TEMPORARY, remove_abandoned, write_bytes

WRITER = """
import sys, time
from pathlib import Path
from fieldcalib._whole_files import replacement
import os
with replacement(Path(sys.argv[1])) as (handle, path):
    os.write(handle, b"half")
    os.close(handle)  # as a video does, whose encoder opens the file again
    time.sleep(600.0)
"""

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no locks of files")


def test_the_file_of_a_killed_process_is_removed_that_of_a_living_one_is_kept(tmp_path):
    remove_abandoned.cache_clear()
    out = tmp_path / "players.csv"
    with subprocess.Popen([sys.executable, "-c", WRITER, str(out)]) as writer:
        try:
            wait_until(lambda: any(one.stat().st_size for one in tmp_path.glob(f"{TEMPORARY}*")))
            write_bytes(out, b"first")
            assert len(list(tmp_path.iterdir())) == 2  # of the living one too
            writer.send_signal(signal.SIGKILL)
        finally:
            writer.kill()
    remove_abandoned.cache_clear()  # of a new process
    write_bytes(out, b"second")
    assert [path.name for path in tmp_path.iterdir()] == ["players.csv"]
    assert out.read_bytes() == b"second"


def test_links_and_folders_of_such_names_are_left(tmp_path):
    remove_abandoned.cache_clear()
    kept = tmp_path / "kept"
    kept.touch()
    (tmp_path / f"{TEMPORARY}link").symlink_to(kept)
    (tmp_path / f"{TEMPORARY}folder").mkdir()
    write_bytes(tmp_path / "a", b"")
    assert len(list(tmp_path.iterdir())) == 4
