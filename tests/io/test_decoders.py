"""Videos as they come: variable rates, turned, interlaced, of ten bits; and without PyAV."""

import socket
import struct
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from fractions import Fraction
from itertools import count, islice

import av
import cv2
import numpy as np
import pytest
from commands import run
from hypothesis import given
from hypothesis import strategies as st
from killed import LONGEST
from strategies import examples

from fieldcalib.io import decoders
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.frame_range import Cut, Position
from fieldcalib.io.image_files import AHEAD, read_ahead
from fieldcalib.io.streams import Stream, StreamReader
from fieldcalib.io.videos import VideoReader, VideoWriter

COUNT, SIZE = 60, (160, 96)
MILLISECONDS = Fraction(1, 1000)
TIMES = np.cumsum(np.random.default_rng(0).integers(15, 120, COUNT))


def picture(number, size=SIZE):
    """A smooth picture in which a square of 16 px shows the number by its place."""
    x, y = (np.linspace(0.0, 1.0, length) for length in size)
    image = (60.0 + 60.0 * x[None, :, None] + 60.0 * y[:, None, None] + np.array([20.0, 0.0, -20.0])).astype(np.uint8)
    row, column = divmod(number, size[0] // 16)
    image[16 * row : 16 * row + 16, 16 * column : 16 * column + 16] = 255
    return image


def shown(image):
    """The number that a picture shows."""
    cells = image.mean(axis=-1).reshape(image.shape[0] // 16, 16, image.shape[1] // 16, 16).mean(axis=(1, 3))
    return int(cells.argmax())


def write(path, images, times=None, *, codec="libx264", pixels="yuv420p", options=None, space=None):
    """A video of images at times in ms, 25 a second by default; `space` is a standard of colours with its number."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25, options=options or {})
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = pixels
        if space is not None:
            stream.codec_context.colorspace = space[1]
        if times is not None:
            stream.codec_context.time_base = MILLISECONDS
        for number, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(image, format="bgr24")
            if times is not None:
                frame.pts, frame.time_base = int(times[number]), MILLISECONDS
            frame = frame.reformat(format=pixels, dst_colorspace=space and space[0])
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def read(path, **options):
    with VideoReader(path, **options) as video:
        return list(video)


@pytest.fixture
def without_av(monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)


def times_of(path):
    return np.array(decoders.file_decoder(path, str(path)).times)


# --- times ---

# long groups that end with frames which need those of the next one; and no group at all after the first frame
GROUPS = {"open": "keyint=20:min-keyint=20:scenecut=0:bframes=3:open-gop=1", "refreshed": "intra-refresh=1:keyint=20"}


@pytest.fixture(
    scope="module",
    params=[
        ("a.mp4", "libx264", "open"),
        ("a.mkv", "libx264", "refreshed"),
        ("a.ts", "libx264", "open"),
        ("a.webm", "libvpx", None),
        ("a.avi", "mpeg4", None),
    ],
    ids=lambda given: given[0],
)
def film(request, tmp_path_factory):
    name, codec, group = request.param
    options = {"x264-params": GROUPS[group]} if group else {"auto-alt-ref": "1", "lag-in-frames": "12"}
    path = tmp_path_factory.mktemp("film") / name
    times = TIMES - TIMES[0] * (codec == "mpeg4")  # AVI has no other beginning
    return write(path, [picture(n) for n in range(COUNT)], times, codec=codec, options=options)


def test_times_are_those_of_the_file(film):
    decoders.index_of.cache_clear()
    with VideoReader(film) as video:
        assert [shown(image) for image in video] == list(range(COUNT))
        assert video.loss() == ""
    times = times_of(film)
    assert times == pytest.approx((TIMES - TIMES[0]) / 1e3, abs=0.00101)
    assert video.frames_per_second == pytest.approx((COUNT - 1) / times[-1], rel=0.05)


def test_a_cut_by_times_begins_and_ends_there(film):
    times = times_of(film)
    for start, end in ((0.0, 1.0), (1.7, 3.4), (times[40], times[50])):
        with VideoReader(film, cut=Cut(Position(seconds=start), Position(seconds=end))) as video:
            expected = np.nonzero((times >= start - 1e-9) & (times < end - 1e-9))[0].tolist()
            assert [number for number, _ in video.numbered()] == expected
    with VideoReader(film, cut=Cut(end=Position(seconds=100.0))) as video:
        assert f"ends at {times[-1] + 1 / video.frames_per_second:.3g} s ({COUNT} frames), before 100 s" in video.beyond
    with pytest.raises(BrokenFileError, match="before 100 s: times are in seconds, and 100f is a frame"):
        VideoReader(film, cut=Cut(Position(seconds=100.0)))


@examples(5)
@given(order=st.lists(st.integers(0, COUNT - 1), min_size=1, max_size=12))
def test_a_frame_is_the_same_whichever_way_it_is_reached(film, order):
    one_by_one = read(film)
    with VideoReader(film) as video:
        for number in order:
            assert np.array_equal(video.image(number), one_by_one[number])
        assert video.image(COUNT) is None
    for number in order[:2]:
        cut = read(film, cut=Cut(Position(frame=number), Position(frame=number + 3)))
        assert all(map(np.array_equal, cut, one_by_one[number : number + 3]))


def test_a_video_may_be_closed_while_a_thread_reads_ahead(film):
    """As where an error ends a run: PyAV would end the process."""
    for taken in range(1, 20):
        with VideoReader(film) as video:
            ahead = read_ahead(video)
            assert len(list(islice(ahead, taken))) == taken
        assert len(list(ahead)) <= AHEAD + 2  # what was read before


# --- pictures ---


@pytest.mark.parametrize(("quarters", "matrix"), [(1, (0, 1, -1, 0)), (2, (-1, 0, 0, -1)), (3, (0, -1, 1, 0))])
def test_videos_of_phones_are_turned(tmp_path, quarters, matrix):
    """The matrix of an MP4 turns clockwise, and OpenCV turns alike."""
    path = write(tmp_path / "a.mp4", [picture(0)] * 3)
    upright = read(path)[0]
    content = bytearray(path.read_bytes())
    place = content.index(b"tkhd") + 44
    assert struct.unpack(">9i", content[place : place + 36]) == (65536, 0, 0, 0, 65536, 0, 0, 0, 1 << 30)
    a, b, c, d = (65536 * one for one in matrix)
    content[place : place + 36] = struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 1 << 30)
    path.write_bytes(content)
    (first, *_) = read(path)
    assert np.array_equal(first, np.rot90(upright, -quarters))
    assert np.array_equal(first, cv2.VideoCapture(str(path)).read()[1])
    with VideoReader(path) as video:
        assert video.size == first.shape[1::-1]


@pytest.mark.parametrize("size", [(160, 96), (161, 91)])
@pytest.mark.parametrize(
    ("codec", "pixels", "most"), [("libx264", "yuv444p10le", 2.0), ("libx264", "yuv444p", 3.0), ("png", "rgb24", 0.0)]
)
def test_colours(tmp_path, size, codec, pixels, most):
    image = picture(0, size)
    options = {"crf": "1"} if codec == "libx264" else {}
    for found in read(write(tmp_path / "a.mov", [image] * 3, codec=codec, pixels=pixels, options=options)):
        assert found.shape == image.shape
        assert np.abs(found[16:, 16:].astype(int) - image[16:, 16:]).max() <= most


@pytest.mark.parametrize("space", [("ITU601", 6), ("ITU709", 1)])
def test_colours_are_those_of_the_standard_that_the_file_names(tmp_path, space):
    image = np.full((96, 160, 3), (40, 160, 60), np.uint8)
    (found, *_) = read(write(tmp_path / "a.mp4", [image] * 3, options={"crf": "1"}, space=space))
    assert np.abs(found.astype(int) - image).max() <= 3  # the other standard is off by 15


@pytest.mark.slow
def test_interlaced_videos_are_left_as_they_are_and_that_is_said_once(tmp_path, know, capfd):
    fields = np.where(np.arange(96)[:, None, None] % 2, picture(1), picture(0)).astype(np.uint8)
    path = write(tmp_path / "a.mp4", [fields] * 8, options={"x264-params": "interlaced=1", "crf": "1"})
    with VideoReader(path) as video:
        (first, *_) = video
        assert "is interlaced" in video.remark
    assert [shown(np.repeat(first[field::2], 2, axis=0)) for field in (0, 1)] == [0, 1]
    know([None] * 20)
    assert run("run", path, "--independent", "--no-pictures", "--out", tmp_path / "out") == 0
    assert capfd.readouterr().err.count("is interlaced") == 1
    with VideoReader(write(tmp_path / "b.mp4", [picture(0)] * 8)) as video:
        assert video.remark == ""


# --- streams ---

SDP = """v=0
o=- 0 0 IN IP4 127.0.0.1
s=clip
c=IN IP4 127.0.0.1
t=0 0
m=video 0 RTP/AVP 96
a=rtpmap:96 H264/90000
a=fmtp:96 packetization-mode=1
a=control:track
""".replace("\n", "\r\n")
ANSWERS = {
    "OPTIONS": "Public: OPTIONS, DESCRIBE, SETUP, PLAY\r\n",
    "DESCRIBE": f"Content-Type: application/sdp\r\nContent-Length: {len(SDP)}\r\n",
    "SETUP": "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\nSession: 1\r\n",
    "PLAY": "Session: 1\r\n",
}


def serve_rtsp(server, packets, is_lost):
    """Answer one reader, and hand it RTP packets that come by UDP, but those that are lost, until none come for long.

    They go through its connection; an empty packet ends them.
    """
    connection, _ = server.accept()
    with connection, connection.makefile("rwb") as stream:
        method = ""
        while method != "PLAY":
            request = [line.decode() for line in iter(stream.readline, b"\r\n")]
            method, number = request[0].split()[0], next(line for line in request if line.startswith("CSeq"))
            said = SDP if method == "DESCRIBE" else ""
            stream.write(f"RTSP/1.0 200 OK\r\n{number}{ANSWERS[method]}\r\n{said}".encode())
            stream.flush()
        packets.settimeout(LONGEST)
        for number in count():
            packet = packets.recv(2000)
            if not packet:
                return
            if not is_lost(number):
                stream.write(b"$\0" + len(packet).to_bytes(2, "big") + packet)
                stream.flush()


def send_rtp(port, images, stall=0.0):
    """Send images as H.264 at 25 a second; before one half of them nothing comes for some seconds.

    Images of another size than those before begin with a new encoder, as in a camera that is switched over.
    """
    with av.open(f"rtp://127.0.0.1:{port}?pkt_size=1200", "w", format="rtp") as container:
        stream, encoder = container.add_stream("libx264", rate=25), None
        stream.height, stream.width = images[0].shape[:2]
        container.start_encoding()
        for number, image in enumerate(images):
            time.sleep(stall * (number == len(images) // 2))
            size = image.shape[1::-1]
            if encoder is None or (encoder.width, encoder.height) != size:
                encoder = av.CodecContext.create("libx264", "w")
                encoder.width, encoder.height = size
                encoder.pix_fmt, encoder.time_base, encoder.framerate = "yuv420p", Fraction(1, 25), 25
                encoder.options = {"tune": "zerolatency", "x264-params": "repeat-headers=1:keyint=10"}
            frame = av.VideoFrame.from_ndarray(image, format="bgr24")
            frame.pts, frame.time_base = number, encoder.time_base
            for packet in encoder.encode(frame):
                packet.stream = stream
                container.mux(packet)
            time.sleep(0.04)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.sendto(b"", ("127.0.0.1", port))


@contextmanager
def camera_by_rtsp(images, is_lost=lambda number: False, stall=0.0):
    """The address of a camera on this machine that shows images once."""
    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as packets,
        ThreadPoolExecutor(2) as pool,
    ):
        packets.bind(("127.0.0.1", 0))
        ends = (
            pool.submit(serve_rtsp, server, packets, is_lost),
            pool.submit(send_rtp, packets.getsockname()[1], images, stall),
        )
        yield f"rtsp://user:word@127.0.0.1:{server.getsockname()[1]}/live"
        for end in ends:
            end.result()


def numbers_by_rtsp(*arguments, **options):
    """The numbers that frames show, and their time stamps in frames, NaN for the first one if it has none."""
    with camera_by_rtsp(*arguments, **options) as address, StreamReader(Stream(address)) as stream:
        assert (stream.size, stream.frames_per_second) == (SIZE, 25.0)
        found = [(shown(image), stream.seconds) for image in stream]
    numbers, seconds = zip(*found, strict=True)
    assert None not in seconds[1:]
    return list(numbers), 25.0 * np.array([np.nan if seconds[0] is None else seconds[0], *seconds[1:]])


def check_all_after_the_first(found, times):
    assert found == list(range(found[0], 40))
    assert len(found) > 20  # a reader that comes late begins with the next keyframe
    np.testing.assert_allclose(np.diff(times[1:]), 1.0, atol=1e-3)


def test_a_camera_by_rtsp():
    check_all_after_the_first(*numbers_by_rtsp([picture(n) for n in range(40)]))


@pytest.mark.slow
def test_a_camera_whose_packets_are_lost():
    found, times = numbers_by_rtsp([picture(n) for n in range(60)], lambda number: number % 40 == 35)
    assert found == sorted(found)  # until the next keyframe some show what was there before
    assert found[-1] > 50
    assert len(set(found)) > 30
    assert np.diff(times[1:]).min() > 0.999


@pytest.mark.slow
def test_a_camera_that_sends_nothing_for_ten_seconds():
    check_all_after_the_first(*numbers_by_rtsp([picture(n) for n in range(40)], stall=10.0))


@pytest.mark.slow
def test_a_camera_that_changes_its_size():
    larger = [picture(n, (320, 192)) for n in range(20, 40)]
    check_all_after_the_first(*numbers_by_rtsp([*(picture(n) for n in range(20)), *larger]))


# --- without PyAV ---


@pytest.mark.parametrize("name", ["a.mp4", "a.mkv"])
def test_without_pyav_opencv_reads(tmp_path, name, request):
    path = write(tmp_path / name, [picture(n) for n in range(30)])
    with_av = read(path)
    request.getfixturevalue("without_av")
    with VideoReader(path) as video:
        assert (len(list(video)), video.loss(), video.count) == (30, "", 30)
        assert video.frames_per_second == 25.0
    assert [number for number, _ in VideoReader(path, cut=Cut(Position(seconds=0.4), None, 5)).numbered()] == [
        10,
        15,
        20,
        25,
    ]
    with VideoReader(path) as video:
        for number in (20, 3, 4, 29):
            assert np.abs(video.image(number).astype(int) - with_av[number]).mean() < 5.0
            assert shown(video.image(number)) == number
        assert video.image(30) is None
    (tmp_path / "b.mp4").write_bytes(b"no video")
    with pytest.raises(BrokenFileError, match=r"b\.mp4: is no video that FFmpeg can read"):
        VideoReader(tmp_path / "b.mp4")


@pytest.mark.usefixtures("without_av")
def test_what_needs_pyav_says_so(tmp_path, capsys):
    said = "videos are written by PyAV, which cannot be imported here: pip install av"
    with pytest.raises(ImportError, match=said), VideoWriter(tmp_path / "a.mp4", 25.0) as video:
        video.write(picture(0))
    with pytest.raises(ImportError, match="streams are read by PyAV"):
        StreamReader(Stream("-"))
    writer = cv2.VideoWriter(str(tmp_path / "b.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, SIZE)
    writer.write(picture(0))
    writer.release()
    assert run("run", tmp_path / "b.avi", "--out", tmp_path / "out") == 2
    assert "overlays (--no-pictures leaves them out) are written by PyAV" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["b.avi"]


BOTH = """
import sys
{imports}
capture = cv2.VideoCapture(sys.argv[1])
with av.open(sys.argv[1]) as container:
    for frame in container.decode(video=0):
        assert (capture.read()[1] == frame.to_ndarray(format="bgr24")).mean() > 0.2
print("both")
"""


@pytest.mark.parametrize("imports", ["import av, cv2", "import cv2, av"])
def test_pyav_and_opencv_work_in_one_process(tmp_path, imports):
    """Each brings an FFmpeg of its own."""
    path = write(tmp_path / "a.mp4", [picture(n) for n in range(5)])
    code = BOTH.format(imports=imports)
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True)
    assert (done.stdout, done.returncode) == ("both\n", 0), done.stderr
