"""A camera of which something is known: from images, clips and streams, in Python and on the command line."""

import json
from functools import cache

import cv2
import numpy as np
import pytest
from commands import lines_of, run
from networks import FIELD, KnownCameras, looked_at
from pictures import picture
from views import camera

from data_tools.synthetic.film import Scene, film
from fieldcalib import Camera, Tracker, calibrate_batch, calibrate_from_images, calibrate_from_segments, calibrate_video
from fieldcalib.assess.findings import WAS_SQUASHED, Verdict
from fieldcalib.cli.camera_options import KnownCamera, read_intrinsics
from fieldcalib.console.arguments import Default
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.io.exports.opencv import format_opencv
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.samples import TrueFrame
from fieldcalib.io.soccernet import format_camera
from fieldcalib.metrics.cameras import camera_difference
from fieldcalib.solve.solver_options import DEFAULT_FLAGS, KNOWN_INTRINSICS_FLAGS
from fieldcalib.solve.solver_options import CalibrationFlags as F

SIZE = (960, 540)
WIDE, NARROW = camera(24, 78, 1400.1, (3.3, 68.2, -17.1), k=(0.06, 0.0)), camera(-2, 78, 2500.7, (3.3, 68.2, -17.1))
ACROSS = camera(178, 78, 2500.7, (3.3, -68.2, -17.1))  # sees what is the same from the main side
PLACE = F.CALIB_FIX_POSITION


def position(truth):
    return {"rvec": np.zeros(3), "tvec": -truth.C}


def intrinsics(truth):
    return {"camera_matrix": truth.K, "dist_coeffs": truth.dist}


def from_image(truth, flags=DEFAULT_FLAGS, **known):
    (found,) = calibrate_from_images(FIELD, [picture(truth)], KnownCameras([truth]), flags=flags, **known)
    assert found.accepted
    return found.camera


# --- images ---


@pytest.mark.parametrize("truth", [WIDE, pytest.param(NARROW, marks=pytest.mark.slow)], ids=["wide", "narrow"])
def test_what_is_known_is_kept_to_the_bit_and_helps(truth):
    free = from_image(truth)
    of_lens = from_image(truth, KNOWN_INTRINSICS_FLAGS, **intrinsics(truth))
    of_place = from_image(truth, DEFAULT_FLAGS | PLACE, **position(truth))
    of_both = from_image(truth, KNOWN_INTRINSICS_FLAGS | PLACE, **intrinsics(truth), **position(truth))
    for found in (of_lens, of_both):
        np.testing.assert_array_equal(found.K, truth.K)
        np.testing.assert_array_equal(found.dist, truth.dist)
    for found in (of_place, of_both):
        np.testing.assert_array_equal(found.C, truth.C)
    before, lens, place, both = (camera_difference(found, truth, FIELD) for found in (free, of_lens, of_place, of_both))
    assert lens.position < 0.5 * before.position
    assert place.focal_length < 0.5 * before.focal_length
    assert both.reprojection < 0.1 < 0.4 < before.reprojection


@pytest.mark.parametrize("truth", [WIDE, NARROW, ACROSS], ids=["wide", "narrow", "across"])
def test_a_known_rotation(truth):
    rvec, *_ = truth.to_opencv()
    found = from_image(truth, KNOWN_INTRINSICS_FLAGS | F.CALIB_FIX_ROTATION, rvec=rvec, **intrinsics(truth))
    given = Camera.from_opencv(rvec, np.zeros(3), truth.K, None, SIZE)
    np.testing.assert_array_equal(found.R, given.R)
    assert camera_difference(found, truth, FIELD).position < 0.1


def test_labels_that_a_known_camera_cannot_explain_are_rejected():
    """What is given is believed, and the verdict tells that the image contradicts it."""
    elsewhere = {"rvec": np.zeros(3), "tvec": -(WIDE.C + (0.0, 0.0, 12.0))}
    (found,) = calibrate_from_images(
        FIELD, [picture(WIDE)], KnownCameras([WIDE]), flags=DEFAULT_FLAGS | PLACE, **elsewhere
    )
    np.testing.assert_array_equal(found.camera.C, WIDE.C + (0.0, 0.0, 12.0))
    assert not found.accepted


def test_a_known_place_of_a_squashed_picture():
    squashed = cv2.resize(picture(WIDE), (720, 540), interpolation=cv2.INTER_AREA)
    network = KnownCameras(4 * [WIDE])  # asked for the picture as it is, and as it would be shown
    (found,) = calibrate_from_images(FIELD, [squashed], network, flags=DEFAULT_FLAGS | PLACE, **position(WIDE))
    assert WAS_SQUASHED in found.findings
    np.testing.assert_array_equal(found.camera.C, WIDE.C)
    assert camera_difference(found.camera.scaled(SIZE), WIDE, FIELD).reprojection < 1.5


def test_a_start_is_not_kept():
    rvec, tvec, K, _ = WIDE.to_opencv()
    guess = F.CALIB_USE_INTRINSIC_GUESS | F.CALIB_USE_EXTRINSIC_GUESS
    near = from_image(
        WIDE, DEFAULT_FLAGS | guess, rvec=rvec, tvec=tvec + 0.5, camera_matrix=1.02 * K + np.diag([0, 0, -0.02])
    )
    assert near.focal_length != 1.02 * WIDE.focal_length
    assert camera_difference(near, WIDE, FIELD).reprojection < 1.5


def test_from_labels_what_is_known_is_kept_to_the_bit():
    pixels = {label: WIDE.project(FIELD[label].sample(4.0)) for label in ("Side line top", "Side line right")}
    pixels |= {"Big rect. right main": WIDE.project(FIELD["Big rect. right main"].sample(4.0))}
    known = {**intrinsics(WIDE), **position(WIDE), "flags": KNOWN_INTRINSICS_FLAGS | PLACE}
    alone = calibrate_from_segments(FIELD, pixels, SIZE, **known)
    (together,) = calibrate_batch(FIELD, [pixels], SIZE, **known)
    (again,) = calibrate_batch(FIELD, [pixels], SIZE, cameras=[together.camera], flags=KNOWN_INTRINSICS_FLAGS | PLACE)
    for found in (alone, together, again):
        np.testing.assert_array_equal(found.camera.K, WIDE.K)
        np.testing.assert_array_equal(found.camera.C, WIDE.C)
        np.testing.assert_allclose(found.camera.angles, WIDE.angles, atol=1e-5)


@pytest.mark.parametrize(
    ("flags", "known", "message"),
    [
        (KNOWN_INTRINSICS_FLAGS, {}, "camera_matrix is missing"),
        (DEFAULT_FLAGS, intrinsics(WIDE), "without one of them camera_matrix would be ignored"),
        (DEFAULT_FLAGS, position(WIDE), "without a flag they would be ignored"),
        (DEFAULT_FLAGS | PLACE, {}, "rvec and tvec are missing"),
        (DEFAULT_FLAGS | F.CALIB_FIX_ROTATION, {}, "rvec is missing"),
        (DEFAULT_FLAGS | F.CALIB_FIX_ROTATION, position(WIDE), "tvec would be ignored"),
        (DEFAULT_FLAGS | PLACE, {"tvec": WIDE.C}, "give both rvec and tvec"),
        (DEFAULT_FLAGS | F.CALIB_AUTO_LENS | F.CALIB_FIX_K1, {}, "CALIB_FIX_K1 and CALIB_AUTO_LENS contradict"),
        (
            KNOWN_INTRINSICS_FLAGS | PLACE | F.CALIB_FIX_ROTATION,
            {**intrinsics(WIDE), **position(WIDE)},
            "the flags leave nothing to estimate",
        ),
    ],
)
def test_flags_that_cannot_be(flags, known, message):
    with pytest.raises(ValueError, match=message):
        calibrate_from_images(FIELD, [picture(WIDE)], KnownCameras([WIDE]), flags=flags, **known)


def test_one_camera_matrix_is_of_one_size():
    truths = [WIDE, WIDE.scaled((640, 360))]
    images = [picture(truth) for truth in truths]
    with pytest.raises(ValueError, match="images of one size, got 960 x 540 and 640 x 360"):
        calibrate_from_images(FIELD, images, KnownCameras(truths), WIDE.K, flags=KNOWN_INTRINSICS_FLAGS)
    found = calibrate_from_images(FIELD, images, KnownCameras(truths), **position(WIDE), flags=DEFAULT_FLAGS | PLACE)
    assert [np.array_equal(one.camera.C, WIDE.C) for one in found] == [True, True]


# --- files ---


def opencv_file(path, truth, size=SIZE, **more):
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    values = {"camera_matrix": truth.K, "distortion_coefficients": truth.dist}
    values |= {} if size is None else {"image_width": size[0], "image_height": size[1]}
    for name, value in (values | more).items():
        file.write(name, value)
    file.release()
    return path


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
def test_files_of_opencv(tmp_path, suffix):
    found = read_intrinsics(opencv_file(tmp_path / f"cam.{suffix}", WIDE))
    np.testing.assert_array_equal(found.camera_matrix, WIDE.K)
    np.testing.assert_array_equal(found.dist_coeffs, WIDE.dist[0])
    assert found.image_size == SIZE
    assert read_intrinsics(opencv_file(tmp_path / f"other.{suffix}", WIDE, None)).image_size is None


def test_camera_files_are_intrinsics_too(tmp_path):
    (tmp_path / "camera_a.json").write_text(format_camera(WIDE))
    found = read_intrinsics(tmp_path / "camera_a.json")
    np.testing.assert_array_equal(found.camera_matrix, WIDE.K)
    np.testing.assert_array_equal(found.dist_coeffs[:5], WIDE.dist[0])
    assert found.image_size is None


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "is no YAML, XML or JSON of cv2.FileStorage"),
        ("<html", "is no YAML, XML or JSON of cv2.FileStorage"),
        ("focal: 3", 'is no YAML|has no key "camera_matrix", only focal'),
        ("{broken", "is no JSON"),
        ("%YAML:1.0\n---\nK: 3\n", 'has no key "camera_matrix", only K'),
        ("%YAML:1.0\n---\ncamera_matrix: 3\n", "camera_matrix is no matrix"),
    ],
)
def test_files_of_something_else(tmp_path, content, message):
    (tmp_path / "cam.yml").write_text(content)
    with pytest.raises(BrokenFileError, match=message) as caught:
        read_intrinsics(tmp_path / "cam.yml")
    assert str(caught.value).startswith(str(tmp_path / "cam.yml"))


def test_a_fisheye_lens_is_one(tmp_path):
    wide = Camera(WIDE.K, WIDE.R, WIDE.C, WIDE.image_size, (0.1, 0.02, 0.0, -0.01), fisheye=True)
    (tmp_path / "cam.yml").write_text(format_opencv(wide))
    found = read_intrinsics(tmp_path / "cam.yml")
    assert found.fisheye
    np.testing.assert_array_equal(found.dist_coeffs, wide.dist[0])
    known = KnownCamera(Default("k1"), intrinsics=found)
    assert known.flags("all") & F.CALIB_FISHEYE
    width, height = WIDE.image_size
    given = known.given.of_size((width // 2, height // 2))
    np.testing.assert_allclose(given.camera_matrix, wide.scaled((width // 2, height // 2)).K)
    np.testing.assert_array_equal(given.dist_coeffs, wide.dist[0])
    with pytest.raises(BrokenFileError, match="of a fisheye lens must be the four finite coefficients"):
        read_intrinsics(opencv_file(tmp_path / "five.yml", WIDE, fisheye_model=1))


# --- the command line ---


@pytest.fixture
def know(monkeypatch):
    """Let the commands use a network that knows the cameras of the images."""

    def replace_network(cameras):
        for module in ("run", "clips"):
            monkeypatch.setattr(f"fieldcalib.cli.{module}.load_network", lambda options: KnownCameras(cameras))

    return replace_network


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("in")
    for name, truth in (("a", WIDE), ("b", WIDE.scaled((1280, 720)))):
        cv2.imwrite(str(path / f"{name}.png"), picture(truth))
    return path


def test_run_with_a_known_camera(know, folder, tmp_path):
    out, place = tmp_path / "out", ",".join(map(str, WIDE.C))
    known = ["--intrinsics", opencv_file(tmp_path / "cam.yml", WIDE), "--position", place]
    know([WIDE, WIDE.scaled((1280, 720))])
    assert run("run", folder, "--out", out, *known) == 0
    for line, size in zip(lines_of(out), (SIZE, (1280, 720)), strict=True):
        assert line["status"] == "accepted"
        assert line["C"] == WIDE.C.tolist()
        np.testing.assert_array_equal(line["K"], WIDE.K if size == SIZE else WIDE.scaled(size).K)
        assert line["angles_degrees"]["pan"] == pytest.approx(24.0, abs=0.01)
    record = json.loads((out / "run.json").read_text())["options"]
    assert record["position"] == WIDE.C.tolist()
    assert str(WIDE.focal_length) in record["intrinsics"]


def test_a_run_is_resumed_with_the_same_known_camera_only(know, folder, tmp_path, capsys):
    out, path = tmp_path / "out", opencv_file(tmp_path / "cam.yml", WIDE)
    know([WIDE, WIDE.scaled((1280, 720))])
    assert run("run", folder, "--out", out, "--intrinsics", path) == 0
    assert run("run", folder, "--out", out, "--intrinsics", path, "--resume") == 0
    assert run("run", folder, "--out", out, "--resume") == 2
    assert "--intrinsics was " in capsys.readouterr().err
    opencv_file(path, NARROW)  # the same file with another content
    assert run("run", folder, "--out", out, "--intrinsics", path, "--resume") == 2
    assert "--intrinsics was " in capsys.readouterr().err
    assert run("run", folder, "--out", out, "--intrinsics", path, "--position", "-1,60,-15", "--resume") == 2
    assert "--position was None, is [-1.0, 60.0, -15.0]" in capsys.readouterr().err


def test_intrinsics_of_images_of_another_shape(know, folder, tmp_path, capsys):
    cv2.imwrite(str(folder / "c.png"), np.zeros((540, 720, 3), np.uint8))
    know([WIDE, WIDE.scaled((1280, 720))])
    assert run("run", folder, "--out", tmp_path / "out", "--intrinsics", opencv_file(tmp_path / "cam.yml", WIDE)) == 1
    message = "c.png: has 720 x 540 pixels, and --intrinsics is of images of 960 x 540: of another shape"
    assert message in capsys.readouterr().err
    assert [line["status"] for line in lines_of(tmp_path / "out")] == ["accepted", "accepted", "broken file"]


def test_intrinsics_without_a_size(know, folder, tmp_path, capsys):
    large = opencv_file(tmp_path / "cam.yml", WIDE.scaled((3840, 2160)), None)
    know([])
    assert run("run", folder, "--out", tmp_path / "out", "--intrinsics", large) == 2
    assert "write image_width and image_height into that file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--position", "1,2"], "argument --position: expected X,Y,Z in metres, as 0,62,-17, got '1,2'"),
        (["--position", "0,62,17"], "z points down, so a camera that is 17 m up has z = -17"),
        (["--rotation", "a,b,c"], "argument --rotation: expected PAN,TILT,ROLL in degrees, as 12,78,0, got 'a,b,c'"),
        (["--intrinsics", "nowhere.yml"], "argument --intrinsics: nowhere.yml: cannot be read"),
        (["--intrinsics", "{}", "--lens", "auto"], "--intrinsics says what the lens is: leave --lens out"),
        (["--intrinsics", "{}", "--lens", "k1"], "--intrinsics says what the lens is: leave --lens out"),
        (["--rotation", "-20,78"], "argument --rotation: expected PAN,TILT,ROLL in degrees, as 12,78,0, got '-20,78'"),
        (["--intrinsics", "{}", "--position", "0,60,-9", "--rotation", "0,80,0"], "leave nothing to estimate"),
    ],
)
def test_wrong_options(know, folder, tmp_path, capsys, options, message):
    path = str(opencv_file(tmp_path / "cam.yml", WIDE))
    know([])
    assert run("run", folder, "--out", tmp_path / "out", *[path if o == "{}" else o for o in options]) == 2
    assert message in capsys.readouterr().err


def test_calibrate_with_a_known_camera(tmp_path):
    pixels = {label: WIDE.project(FIELD[label].sample(4.0)) for label in ("Side line right", "Big rect. right main")}
    seen = {label: [xy for xy in found if np.all((xy > 0.0) & (xy < SIZE))] for label, found in pixels.items()}
    record = {label: [{"x": x / 959, "y": y / 539} for x, y in found] for label, found in seen.items()}
    (tmp_path / "a.json").write_text(json.dumps(record))
    place = ",".join(map(str, WIDE.C))
    known = ["--intrinsics", opencv_file(tmp_path / "cam.xml", WIDE.scaled((1920, 1080)), (1920, 1080))]
    command = ["calibrate", tmp_path / "a.json", "--size", "960x540", "--out", tmp_path / "out"]
    assert run(*command, *known, "--position", place) == 0
    (line,) = lines_of(tmp_path / "out")
    np.testing.assert_array_equal(line["K"], WIDE.K)
    assert line["C"] == WIDE.C.tolist()
    assert line["angles_degrees"]["pan"] == pytest.approx(24.0, abs=1e-3)
    assert run(*command[:3], "640x480", *command[4:], "--overwrite", *known) == 2
    assert run(*command, "--overwrite", *known, "--field-size", "estimated") == 2


# --- clips ---

KNOWN = soccer(size_known=True, line_width=0.0)  # as its pictures are drawn
SMALL = (480, 270)
PANS = np.radians(np.linspace(20.0, 24.0, 8))


@cache
def clip_of(zoom):
    """Cameras that turn, and zoom in by a share, and what they film."""
    lengths = 700.3 * np.linspace(1.0, 1.0 + zoom, len(PANS))
    cameras = [
        Camera.from_angles(pan, 1.36, 0.0, f, (3.3, 68.2, -17.1), SMALL, k=(0.06, 0.0))
        for pan, f in zip(PANS, lengths, strict=True)
    ]
    return cameras, list(film(Scene.random(KNOWN, 5, cameras), [TrueFrame(one, 0, 0) for one in cameras]))


def from_clip(cameras, pictures, flags=DEFAULT_FLAGS, **known):
    network = KnownCameras([cameras[t] for t in looked_at(pictures, cameras)])
    return calibrate_video(KNOWN, pictures, network, flags=flags, **known)


@cache
def from_clip_alone(zoom):
    """What is found of the clip where nothing is known of its camera."""
    return from_clip(*clip_of(zoom))


def largest_error(found, cameras):
    """Largest of the frames' errors in the picture, pixels."""
    return max(
        camera_difference(one.camera, truth, KNOWN).reprojection for one, truth in zip(found, cameras, strict=True)
    )


@pytest.mark.slow
def test_a_clip_whose_position_is_known():
    cameras, pictures = clip_of(zoom=0.1)
    found = from_clip(cameras, pictures, DEFAULT_FLAGS | PLACE, **position(cameras[0]))
    assert len(found.tripods) == 1
    assert not {"x", "y", "z", "axis offset"} & found.tripods[0].shared.keys()
    for one in found:
        assert one.accepted
        np.testing.assert_array_equal(one.camera.C, cameras[0].C)
    assert largest_error(found, cameras) < min(1.0, largest_error(from_clip_alone(0.1), cameras))


@pytest.mark.slow
@pytest.mark.parametrize("more", [0, PLACE], ids=["lens", "lens and position"])
def test_a_clip_whose_lens_is_known(more):
    cameras, pictures = clip_of(zoom=0.0)
    known = intrinsics(cameras[0]) | (position(cameras[0]) if more else {})
    found = from_clip(cameras, pictures, KNOWN_INTRINSICS_FLAGS | more, **known)
    assert len(found.tripods) == 1
    for one in found:
        assert one.accepted
        np.testing.assert_allclose(one.camera.K, cameras[0].K, rtol=1e-15)
        np.testing.assert_allclose(one.camera.dist, cameras[0].dist, rtol=1e-15)
        if more:
            np.testing.assert_array_equal(one.camera.C, cameras[0].C)
    assert largest_error(found, cameras) < min(0.5, largest_error(from_clip_alone(0.0), cameras))
    again = type(found).from_dict(json.loads(json.dumps(found.to_dict())))
    assert list(again) == list(found)


@pytest.mark.slow
def test_a_clip_on_the_command_line(know, tmp_path):
    cameras, pictures = clip_of(zoom=0.0)
    for t, image in enumerate(pictures):
        cv2.imwrite(str(tmp_path / f"{t}.png"), image)
    know([cameras[t] for t in looked_at(pictures, cameras)])
    path, place = opencv_file(tmp_path / "cam.yml", cameras[0].scaled(SIZE)), ",".join(map(str, cameras[0].C))
    command = ["run", tmp_path, "--clip", "--out", tmp_path / "out", "--field-size", "known"]
    assert run(*command, "--intrinsics", path, "--rotation", "20,78,0") == 2
    assert run(*command, "--intrinsics", path, "--position", place) == 0
    for line in lines_of(tmp_path / "out"):
        assert line["status"] == "accepted"
        assert line["C"] == cameras[0].C.tolist()
        np.testing.assert_allclose(line["K"], cameras[0].K, rtol=1e-12)


def test_what_is_of_one_frame_is_not_of_a_clip():
    rvec, tvec, *_ = WIDE.to_opencv()
    for flags, pose in ((F.CALIB_FIX_ROTATION, (rvec,)), (F.CALIB_USE_EXTRINSIC_GUESS, (rvec, tvec))):
        with pytest.raises(ValueError, match="a rotation is of one frame"):
            calibrate_video(KNOWN, [], KnownCameras([]), None, None, *pose, flags=DEFAULT_FLAGS | flags)
        with pytest.raises(ValueError, match="a rotation is of one frame"):
            Tracker(KNOWN, KnownCameras([]), None, None, *pose, flags=DEFAULT_FLAGS | flags)
    with pytest.raises(ValueError, match='leave camera="moving" out'):
        calibrate_video(KNOWN, [], KnownCameras([]), **position(WIDE), flags=DEFAULT_FLAGS | PLACE, camera="moving")


@pytest.mark.slow
def test_a_live_camera_whose_place_is_known():
    cameras, pictures = clip_of(zoom=0.1)
    with Tracker(KNOWN, KnownCameras(cameras), **position(cameras[0]), flags=DEFAULT_FLAGS | PLACE, wait=True) as live:
        found = [live.update(image) for image in pictures]
    for one in found:
        assert one.accepted
        np.testing.assert_array_equal(one.camera.C, cameras[0].C)
    assert largest_error(found, cameras) < 2.0


@pytest.mark.parametrize(
    "off",
    [
        (0.0, 0.0, 0.0),
        (5.0, 0.0, 0.0),
        *(pytest.param(off, marks=pytest.mark.slow) for off in ((0.0, 5.0, 0.0), (-3.5, 3.5, 0.0), (0.0, 0.0, -5.0))),
    ],
)
def test_paint_tells_a_position_that_is_wrong_by_five_metres(off):
    """What contradicts a given position is left out of the fit, and must not be forgotten."""
    given, flags = Camera(WIDE.K, WIDE.R, WIDE.C + off, SIZE, WIDE.dist), DEFAULT_FLAGS | PLACE
    (found,) = calibrate_from_images(FIELD, [picture(WIDE)], KnownCameras([WIDE]), **position(given), flags=flags)
    assert (found.verdict is Verdict.GOOD) is (not any(off))
