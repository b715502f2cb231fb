"""What `fieldcalib run` reads: lists, several videos, parts of them, streams; and the folders of their results."""

import http.server
import json
import os
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import cv2
import killed
import numpy as np
import pytest
from commands import lines_of, run
from killed import LONGEST
from networks import FIELD

import fieldcalib
from fieldcalib import Camera
from fieldcalib.cli.clips import run_several
from fieldcalib.cli.commands import command_parser
from fieldcalib.cli.run_options import RunRequest, split_request
from fieldcalib.draw.scene import render_field
from fieldcalib.io.streams import Receiver, Stream
from fieldcalib.io.videos import VideoReader

TRUTH = Camera.from_angles(0.2, 1.32, 0.0, 475.0, (1.0, 66.0, -16.0), (480, 270))
SMALL = np.zeros((36, 64, 3), np.uint8)


@pytest.fixture(scope="module")
def picture():
    return render_field(TRUTH, FIELD, rng=np.random.default_rng(0))


def write_video(path, images):
    path.parent.mkdir(exist_ok=True)
    height, width = images[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 25.0, (width, height))
    for image in images:
        writer.write(image)
    writer.release()
    return path


def ids_of(out):
    return [line["id"] for line in lines_of(out)]


# --- lists ---


def test_a_list_of_paths_relative_to_its_folder(know, tmp_path):
    know([None] * 20)
    (tmp_path / "lists" / "images").mkdir(parents=True)
    for name in "abc":
        cv2.imwrite(str(tmp_path / "lists" / "images" / f"{name}.png"), SMALL)
    text = f"\ufeffimages/b.png\r\n\n  {tmp_path / 'lists' / 'images' / 'a.png'}\n"
    (tmp_path / "lists" / "some.txt").write_text(text, encoding="utf-8")
    assert run("run", f"@{tmp_path / 'lists' / 'some.txt'}", "--out", tmp_path / "out") == 0
    assert ids_of(tmp_path / "out") == ["b", "a"]


def test_lists_of_annotations(annotated_folder, tmp_path):
    (tmp_path / "list.txt").write_text(f"{annotated_folder / 'b.json'}\n")
    assert run("calibrate", f"@{tmp_path / 'list.txt'}", "--size", "960x540", "--out", tmp_path / "out") == 0
    assert ids_of(tmp_path / "out") == ["b"]


@pytest.mark.skipif(
    not Path("/dev/fd").is_dir(), reason="shells hand lists over as pipes in /dev/fd, which is absent here"
)
def test_a_list_may_come_through_a_pipe(annotated_folder, tmp_path):
    there, here = os.pipe()
    os.write(here, f"{annotated_folder / 'b.json'}\n".encode())
    os.close(here)
    assert run("calibrate", f"@/dev/fd/{there}", "--size", "960x540", "--out", tmp_path / "out") == 0
    os.close(there)
    assert ids_of(tmp_path / "out") == ["b"]


def test_lists_that_are_none(tmp_path, capsys):
    (tmp_path / "empty.txt").write_text("\n")
    missing = "none.txt does not exist: expected a text file with a path on each line"
    for name, complaint in (("empty.txt", "lists nothing: expected a path on each line"), ("none.txt", missing)):
        assert run("run", f"@{tmp_path / name}", "--out", tmp_path / "out") == 2
        assert complaint in capsys.readouterr().err


# --- several ---


@pytest.mark.slow
def test_each_video_has_its_own_folder_and_the_rest_is_done(know, tmp_path, capfd):
    know([None] * 20)
    write_video(tmp_path / "a.mp4", [SMALL] * 2)
    (tmp_path / "b.mp4").write_bytes(b"no video")
    season = tmp_path / "season"
    for name in ("c.mp4", "d.avi"):
        write_video(season / name, [SMALL] * 3)
    cv2.imwrite(str(tmp_path / "e.png"), SMALL)
    inputs = [tmp_path / name for name in ("a.mp4", "b.mp4", "season", "e.png")]
    assert run("run", *inputs, "--independent", "--out", tmp_path / "out") == 1
    assert "b.mp4: is no video that FFmpeg can read" in capfd.readouterr().err
    written = {path.name: len(lines_of(path)) for path in (tmp_path / "out").iterdir()}
    assert written == {"images": 1, "a": 2, "c": 3, "d": 3}


@pytest.mark.slow
def test_clips_side_by_side(picture, tmp_path, capfd):
    """With the network that comes along: other processes know no other."""
    season = tmp_path / "season"
    for name, count in (("a.mp4", 2), ("b.mp4", 1)):
        write_video(season / name, [picture] * count)
    (tmp_path / "c.mp4").write_bytes(b"no video")
    for jobs in (1, 2):
        out = tmp_path / f"out{jobs}"
        assert run("run", season, tmp_path / "c.mp4", "--out", out, "--jobs", jobs) == 1
        said = capfd.readouterr()
        assert "c.mp4: is no video that FFmpeg can read" in said.err
        assert "2 cameras of 2 frames" in said.out
        assert "1 camera of 1 frame" in said.out
    for name in ("a", "b"):
        one, other = (tmp_path / f"out{jobs}" / name for jobs in (1, 2))
        assert (one / "cameras.jsonl").read_bytes() == (other / "cameras.jsonl").read_bytes()
        assert (one / "tripods.json").read_bytes() == (other / "tripods.json").read_bytes()


def test_a_process_that_ends_costs_its_clip_alone(tmp_path, capfd):
    given = ["run", "a.mp4", "dies.mp4", "b.mp4", "--jobs", "2", "--out", str(tmp_path)]
    requests = split_request(RunRequest.of(command_parser(given).parse_args(given)))
    assert run_several(requests, killed.ends_on_dies) == 1
    said = capfd.readouterr()
    assert said.out == "a.mp4 done\nb.mp4 done\n"
    assert "dies.mp4: the process that worked on it ended with exit code 9: --resume goes on with it" in said.err


def test_a_folder_with_one_video_may_get_more(know, tmp_path):
    know([None] * 20)
    write_video(tmp_path / "season" / "c.mp4", [SMALL] * 2)
    assert run("run", tmp_path / "season", "--independent", "--out", tmp_path / "out") == 0
    assert ids_of(tmp_path / "out" / "c") == ["000000", "000001"]


def test_videos_of_one_name(know, tmp_path, capsys):
    know([None] * 20)
    paths = [write_video(tmp_path / folder / "match.mp4", [SMALL]) for folder in ("one", "two")]
    assert run("run", *paths, "--independent", "--out", tmp_path / "out") == 2
    assert f"{paths[0]} and {paths[1]} would both write to {tmp_path / 'out' / 'match'}" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


# --- parts ---


@pytest.mark.parametrize("independent", [True, False])
def test_a_part_of_a_video(know, tmp_path, picture, independent):
    know([TRUTH] * 3)
    video = write_video(tmp_path / "a.mp4", [picture] * 10)
    options = ["--start", "0.08", "--end", "8f", "--step", "2", *(["--independent"] * independent)]
    assert run("run", video, *options, "--out", tmp_path / "out") == 0
    assert ids_of(tmp_path / "out") == ["000002", "000004", "000006"]
    with VideoReader(tmp_path / "out" / "overlay.mp4") as overlay:
        assert (len(list(overlay)), overlay.frames_per_second) == (3, 12.5)


def test_a_part_of_images(know, tmp_path, capsys):
    know([None] * 20)
    for number in range(7):
        cv2.imwrite(str(tmp_path / f"{number}.png"), SMALL)
    assert run("run", tmp_path, "--start", "1f", "--end", "6f", "--step", "2", "--out", tmp_path / "out") == 0
    assert ids_of(tmp_path / "out") == ["1", "3", "5"]
    for start, complaint in (
        ("1:00", "images have no times"),
        ("7f", "the input ends after 7 frames, before frame 7"),
        ("x", "a time"),
    ):
        assert run("run", tmp_path, "--start", start, "--out", tmp_path / "other") == 2
        assert complaint in capsys.readouterr().err


# --- streams ---


@pytest.fixture
def on_stdin():
    """Puts a file on standard input, as FFmpeg finds it."""
    kept = os.dup(0)

    def put(path):
        handle = os.open(path, os.O_RDONLY)
        os.dup2(handle, 0)
        os.close(handle)

    yield put
    os.dup2(kept, 0)
    os.close(kept)


@pytest.fixture(scope="module")
def film(picture, tmp_path_factory):
    return write_video(tmp_path_factory.mktemp("film") / "film.mkv", [picture] * 6)


def test_a_video_on_standard_input(know, film, tmp_path, on_stdin, capfd):
    know([TRUTH] * 6)
    on_stdin(film)
    assert run("run", "-", "--out", tmp_path, "--line-width", "0") == 0  # as the film is drawn
    assert "standard input: no more frames after 6" in capfd.readouterr().err
    lines = lines_of(tmp_path)
    assert [line["id"] for line in lines] == [f"{number:06d}" for number in range(6)]
    for line in lines:
        np.testing.assert_allclose(line["angles_degrees"]["pan"], np.degrees(TRUTH.angles[0]), atol=0.1)
        assert line["basis"]
    assert json.loads((tmp_path / "summary.json").read_text())["cameras"] == 6
    with VideoReader(tmp_path / "overlay.mp4") as overlay:
        assert len(list(overlay)) == 6
    on_stdin(film)
    assert run("run", "-", "--out", tmp_path) == 2
    assert capfd.readouterr().err.endswith(f"{tmp_path} holds the results of a run: --overwrite begins anew\n")


@pytest.fixture
def programs():
    """Two sockets that get packets by UDP, as an engine and a program of one's own."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as two,
    ):
        for program in (one, two):
            program.bind(("127.0.0.1", 0))
            program.settimeout(LONGEST)
        yield one, two


def at(program, scheme):
    return f"--send={scheme}://127.0.0.1:{program.getsockname()[1]}"


def test_cameras_of_a_stream_are_sent_as_they_come(know, film, tmp_path, on_stdin, programs):
    know([TRUTH] * 6)
    on_stdin(film)
    sent = [at(program, scheme) for program, scheme in zip(programs, ("json", "freed"), strict=True)]
    assert run("run", "-", "--out", tmp_path, "--line-width", "0", *sent) == 0
    lines = lines_of(tmp_path)
    for line in (tmp_path / "cameras.jsonl").read_text().splitlines():
        assert programs[0].recv(65_535).decode() == line
    np.testing.assert_allclose([line["time_s"] for line in lines], np.arange(6) / 25.0, atol=1e-3)  # 1 ms in Matroska
    for line in lines:
        packet = programs[1].recv(100)
        pan, tilt = (int.from_bytes(packet[k : k + 3], "big", signed=True) / 32_768 for k in (2, 5))
        assert (len(packet), packet[0]) == (29, 0xD1)
        np.testing.assert_allclose(
            [pan, tilt + 90.0], [line["angles_degrees"][name] for name in ("pan", "tilt")], atol=1e-3
        )


def test_without_a_camera_no_packet_is_sent(know, film, tmp_path, on_stdin, programs):
    know([None] * 20)
    on_stdin(film)
    assert run("run", "-", "--out", tmp_path, at(programs[0], "json"), at(programs[1], "freed")) == 0
    assert [json.loads(programs[0].recv(65_535))["verdict"] for _ in range(6)] == ["reject"] * 6
    programs[1].settimeout(0.1)
    with pytest.raises(TimeoutError):
        programs[1].recv(100)


@pytest.mark.parametrize(
    "address",
    ["127.0.0.1:4000", "udp://127.0.0.1:4000", "json://127.0.0.1", "freed://:4000", "json://a:b", "json://a:4000/b"],
)
def test_addresses_of_no_receiver(know, film, tmp_path, on_stdin, capfd, address):
    know([None] * 20)
    on_stdin(film)
    assert run("run", "-", "--out", tmp_path / "out", "--send", address) == 2
    assert "expected the address of a receiver as freed://192.168.1.20:40000 or json" in capfd.readouterr().err
    assert not (tmp_path / "out").exists()


def test_only_cameras_of_streams_are_sent(know, film, tmp_path, capfd):
    know([None] * 20)
    assert run("run", film, "--out", tmp_path / "out", "--send", "json://127.0.0.1:4000") == 2
    assert "--send is of streams" in capfd.readouterr().err


def test_what_cannot_be_sent_is_counted(programs):
    far = Camera.from_angles(0.0, 1.3, 0.0, 900.0, (0.0, 150.0, -16.0), (960, 540))
    with Receiver(at(programs[0], "freed").partition("=")[2]) as receiver:
        receiver.send({}, TRUTH)
        assert receiver.loss == ""
        receiver.send({}, far)
        receiver.send({}, far)
        assert receiver.loss.startswith(
            f"2 frames could not be sent to freed://127.0.0.1:{programs[0].getsockname()[1]}: "
        )
        assert "FreeD holds positions of less than 131 m" in receiver.loss
    with Receiver(at(programs[1], "json").partition("=")[2]) as receiver:
        receiver.send({"id": 70_000 * "a"}, None)  # more than a packet holds
        assert "1 frames could not be sent" in receiver.loss


def test_a_stream_of_a_known_camera(know, film, tmp_path, on_stdin, capfd):
    know([TRUTH] * 6)
    lens = cv2.FileStorage(str(tmp_path / "cam.yml"), cv2.FILE_STORAGE_WRITE)
    lens.write("camera_matrix", TRUTH.scaled((1920, 1080)).K)
    lens.write("distortion_coefficients", TRUTH.dist)
    lens.write("image_width", 1920)
    lens.write("image_height", 1080)
    lens.release()
    on_stdin(film)
    known = ["--intrinsics", tmp_path / "cam.yml", "--position", ",".join(map(str, TRUTH.C))]
    assert run("run", "-", "--out", tmp_path / "out", *known) == 0
    for line in lines_of(tmp_path / "out"):
        assert line["C"] == TRUTH.C.tolist()
        np.testing.assert_allclose(line["K"], TRUTH.K, rtol=1e-12)
    on_stdin(film)
    assert run("run", "-", "--out", tmp_path / "other", "--rotation", "0,78,0") == 2
    assert "a rotation is of one frame" in capfd.readouterr().err


def test_a_part_of_a_stream(know, film, tmp_path, on_stdin, capfd):
    know([TRUTH] * 6)
    on_stdin(film)
    assert run("run", "-", "--start", "2f", "--end", "4f", "--out", tmp_path) == 0
    assert ids_of(tmp_path) == ["000002", "000003"]
    assert "no more frames" not in capfd.readouterr().err


def test_a_stream_that_breaks_off_keeps_what_came(know, film, tmp_path, on_stdin, capfd):
    know([TRUTH] * 6)
    (tmp_path / "cut.mkv").write_bytes(film.read_bytes()[: int(0.97 * film.stat().st_size)])
    on_stdin(tmp_path / "cut.mkv")
    assert run("run", "-", "--out", tmp_path / "out") == 0
    count = len(lines_of(tmp_path / "out"))
    assert 0 < count < 6
    assert f"standard input: no more frames after {count}" in capfd.readouterr().err


@pytest.mark.parametrize("side", [30_000, *(pytest.param(side, marks=pytest.mark.slow) for side in (0, 5000, 65_535))])
def test_a_damaged_frame_of_a_stream_is_left_out(know, picture, tmp_path, on_stdin, capfd, side):
    """A JPEG whose header states a size that its data cannot have, as from a camera with a bad line."""
    know([TRUTH] * 6)
    jpeg = cv2.imencode(".jpg", picture)[1].tobytes()
    height = jpeg.index(b"\xff\xc0") + 5
    damaged = jpeg[:height] + side.to_bytes(2, "big") * 2 + jpeg[height + 4 :]
    (tmp_path / "film.mjpeg").write_bytes(jpeg * 2 + damaged + jpeg * 4)
    on_stdin(tmp_path / "film.mjpeg")
    assert run("run", "-", "--out", tmp_path / "out") == 1
    assert "standard input: 1 of 7 frames cannot be decoded, and were left out\n" in capfd.readouterr().err
    assert ids_of(tmp_path / "out") == [f"{number:06d}" for number in (0, 1, 3, 4, 5, 6)]
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["cameras"] == 6


def test_an_interrupt_ends_a_stream_with_all_that_came(know, film, tmp_path, on_stdin, monkeypatch, capfd):
    know([TRUTH] * 6)
    on_stdin(film)
    from fieldcalib.images.clip.tracker import Tracker

    update, seen = Tracker.update, []

    def interrupted(tracker, image):
        seen.append(image)
        if len(seen) == 4:
            raise KeyboardInterrupt
        return update(tracker, image)

    monkeypatch.setattr(Tracker, "update", interrupted)
    assert run("run", "-", "--out", tmp_path) == 130
    assert len(lines_of(tmp_path)) == 3
    assert json.loads((tmp_path / "summary.json").read_text())["frames"] == 3
    with VideoReader(tmp_path / "overlay.mp4") as overlay:
        assert len(list(overlay)) == 3


@pytest.mark.slow  # the tracker alone: test_tracker
@pytest.mark.parametrize("frame", [0, 3])
def test_a_live_stream_goes_on_when_its_other_process_is_killed(
    know, film, tmp_path, on_stdin, monkeypatch, capfd, frame
):
    """As the system kills one when memory is short: cameras, lines and overlay go on."""
    from fieldcalib.images.clip.tracker import Tracker

    know([TRUTH] * 6)
    on_stdin(film)
    monkeypatch.setattr(Stream, "is_live", True)
    update, seen, ended = Tracker.update, [], []

    def disturbed(tracker, image):
        seen.append(image)
        if len(seen) == frame + 1:
            ended.append(tracker._other._process)
            ended[0].kill()
        calibration, until = update(tracker, image), time.monotonic() + LONGEST
        while ended and not calibration.accepted and time.monotonic() < until:  # frames come faster than solutions
            time.sleep(0.05)
            calibration = update(tracker, image)
        return calibration

    monkeypatch.setattr(Tracker, "update", disturbed)
    monkeypatch.setattr("fieldcalib.io.image_files.MOST_WAITING", 6)  # none is dropped
    assert run("run", "-", "--out", tmp_path) == 0
    assert ended[0].poll() == -9
    err = capfd.readouterr().err
    assert "with exit code -9: another one goes on" in err
    assert "results came" in err
    lines = lines_of(tmp_path)
    assert [line["status"] for line in lines[frame:]] == ["accepted"] * (6 - frame)
    assert len(lines) == 6
    with VideoReader(tmp_path / "overlay.mp4") as overlay:
        assert len(list(overlay)) == 6


def test_nothing_on_standard_input(know, tmp_path, on_stdin, capfd):
    know([None] * 20)
    on_stdin(os.devnull)
    assert run("run", "-", "--out", tmp_path / "out") == 2
    assert "fieldcalib: standard input: is no video that FFmpeg can read" in capfd.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("option", ["--resume", "--independent", "--no-refinement", "--clip", "--shard=1/2"])
def test_what_streams_have_no_use_for(know, tmp_path, capsys, option):
    know([None] * 20)
    assert run("run", "-", option, "--out", tmp_path) == 2
    assert option.split("=")[0] in capsys.readouterr().err


def test_a_stream_by_http(know, film, tmp_path):
    know([TRUTH] * 6)

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def __init__(self, *arguments):
            super().__init__(*arguments, directory=film.parent)

        def log_message(self, *arguments):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Quiet) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            url = f"http://127.0.0.1:{server.server_port}/film.mkv"
            assert run("run", url, "--out", tmp_path / "out") == 0
        finally:
            server.shutdown()
            thread.join()
    assert len(lines_of(tmp_path / "out")) == 6


def test_which_streams_are_live_and_what_they_are_called():
    live = Stream("rtsp://user:word@host:554/live/1")
    assert (str(live), live.name, live.is_live) == ("rtsp://host:554/live/1", "host_554_live_1", True)
    assert not Stream("-").is_live
    assert not Stream("https://host/a.mkv").is_live


# --- threads ---

COUNTING = """
import os, sys, threading, time
from fieldcalib.cli.main import main
most = 0
def count():
    global most
    while True:
        most = max(most, len(os.listdir("/proc/self/task")))
        time.sleep(0.005)
threading.Thread(target=count, daemon=True).start()
code = main()
print("threads", most - 1)
sys.exit(code)
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="counts threads as Linux has them")
def test_one_thread_is_one_that_computes(tmp_path, picture):
    write_video(tmp_path / "a.mp4", [picture] * 4)
    command = [sys.executable, "-c", COUNTING, "run", tmp_path / "a.mp4", "--out", tmp_path / "out", "--threads", "1"]
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    folder = Path(fieldcalib.__file__).parents[1]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=folder, check=True)
    threads = int(done.stdout.split()[-1])
    # beside it one reads ahead, one looks whether reads come back, one tells how far it is, and PyAV may have one
    assert threads <= 5


@pytest.fixture
def server():
    """A server that answers every request with a text."""

    class Text(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.end_headers()
            self.wfile.write(b"no video")

        def log_message(self, *words):
            pass

    with http.server.HTTPServer(("127.0.0.1", 0), Text) as one:
        thread = threading.Thread(target=one.serve_forever, daemon=True)
        thread.start()
        yield one.server_address[1]
        one.shutdown()
        thread.join()


def closed_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def test_a_stream_that_cannot_be_reached_is_no_question_of_formats(server, tmp_path, capfd):
    nothing = closed_port()
    for address, said in (
        (
            f"http://me:s3cret@127.0.0.1:{nothing}/a.m3u8",
            f"nothing answers at 127.0.0.1, port {nothing} (Connection refused)",
        ),
        ("http://me:s3c@ret@nowhere.invalid/a.ts", "the name nowhere.invalid is not known"),
        (f"http://me:s3cret@127.0.0.1:{server}/a.ts?token=s3cret", "127.0.0.1 answers, but sends no video"),
    ):
        assert run("run", address, "--out", tmp_path / "out") == 2
        error = capfd.readouterr().err.splitlines()[-1]
        assert f" cannot be opened: {said}" in error
        assert "s3c" not in error
        assert ("Matroska" in error) == ("answers, but" in error)
        assert ("firewall" in error) != ("answers, but" in error)
        with pytest.raises(ValueError, match=said.partition(" (")[0]) as from_python:
            fieldcalib.calibrate(address, end=1, progress=False)
        assert "s3c" not in str(from_python.value)
    assert not (tmp_path / "out").exists()
