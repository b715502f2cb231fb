"""A folder that one run at a time writes to."""

import subprocess
import sys
from pathlib import Path

import pytest

from fieldcalib.io.output_folder import output_folder

OTHER_RUN = "another run or page writes to .*: wait for its end, or give another folder"


def test_it_is_made_and_nothing_is_left_in_it(tmp_path):
    out = tmp_path / "new" / "folder"
    with output_folder(out):
        assert list(out.iterdir()) == []
    assert list(out.iterdir()) == []


def test_one_run_at_a_time(tmp_path):
    with output_folder(tmp_path):
        with pytest.raises(OSError, match=OTHER_RUN), output_folder(tmp_path):
            pytest.fail("two runs")
        with output_folder(tmp_path / "another"):
            pass
    with output_folder(tmp_path):
        pass


def test_a_run_that_failed_does_not_keep_others_out(tmp_path):
    with pytest.raises(KeyboardInterrupt), output_folder(tmp_path):
        raise KeyboardInterrupt
    with output_folder(tmp_path):
        pass


def test_neither_does_one_that_was_killed(tmp_path):
    code = (
        "import sys, time; from pathlib import Path; from fieldcalib.io.output_folder import output_folder\n"
        "with output_folder(Path(sys.argv[1])): print('locked', flush=True); time.sleep(60)"
    )
    run = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert run.stdout.readline() == "locked\n"
    with pytest.raises(OSError, match=OTHER_RUN), output_folder(tmp_path):
        pytest.fail("two runs")
    run.kill()
    run.communicate()
    with output_folder(tmp_path):
        pass


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs a folder that not even root can write to")
def test_a_folder_that_cannot_be_written_to():
    with pytest.raises(OSError, match="/proc/self"), output_folder(Path("/proc/self")):
        pytest.fail("has worked")
