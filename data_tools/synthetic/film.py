"""Pictures of a synthetic clip: one stadium, fixed in the world, with players who run and boards that change.

Every picture draws the scene anew from the same seed, so that ground, stands and goals stay where they are.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path

import cv2
import numpy as np

from data_tools.synthetic.colours import BOARD_SCALE, boards_texture
from data_tools.synthetic.objects import (
    NEAREST,
    TEAM_SHARES,
    Drawable,
    Kit,
    Person,
    add_far_to_near,
    add_person,
    random_goals,
    random_kit,
    random_suns,
    soccer_goals,
)
from data_tools.synthetic.paths import RATE, MeasuredZoom, camera_between, camera_path, flight, seen_far_away
from data_tools.synthetic.pictures import add_graphics
from data_tools.synthetic.surroundings import GroundView, add_surroundings, random_ground, random_light
from fieldcalib._types import Array, Float32
from fieldcalib._whole_files import write_text
from fieldcalib.draw.scene import to_uint8
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.image_files import Image
from fieldcalib.io.samples import TRUTH, TrueFrame
from fieldcalib.io.soccernet import camera_to_record
from fieldcalib.io.videos import VideoWriter

CLIP_SIZE = (960, 540)
LEAST_PATH = 150  # frames: shorter clips are parts of a path of this length, which covers all its ranges
BESIDE = 1.2  # m: the close-up camera stands beside the main one

SHUTTER = 0.5  # exposure as a share of the time between two frames: the usual 180 degrees
BLUR_STEP = 1.0  # px: largest motion between two instants of an exposure
MOST_BLUR = 0.1  # of the image's width: faster pans have shorter exposures
CELL = 8  # px: side of the cells in which a warp is linear
OPTICS, GRAIN = 0.5, 2.0  # standard deviations: blur in pixels, noise in grey values
BOARD_PERIOD, BOARD_SPEED = 6.0, 1.5  # s for which boards show one content; m/s at which every second one scrolls

PLAYERS = 22
TEAMS = ("home", "away", "home keeper", "away keeper", "referee")  # as in TEAM_SHARES
BOX = 0.5  # width of the boxes of players, as a share of their height
SPREAD = (14.0, 10.0)  # m: standard deviations around the play, along the length and the width
FOLLOWING, LOOKING = 0.8, 2.0  # share of the camera's motion that players follow; s of averaging
WANDER, WANDER_TIME = 3.0, 1.2  # m and s of random running, at a few metres per second
SPRINT, CADENCE = 7.0, 1.4  # m/s at full stride; pairs of steps per second
STRIDE, SWING = 0.28, 0.25  # of the height, at full stride, see `Person`

# Parts of a scene that are drawn independently of each other
CAMERAS, LIGHT, GROUND, STANDS, GOALS, PEOPLE, GRAPHICS, BOARDS, NOISE, PAINTED = range(10)


@dataclass(frozen=True, eq=False)
class Scene:
    """A stadium during a clip."""

    field: Field
    seed: int
    rate: float
    """Frames a second."""
    positions: Array
    """Metres on the ground, (frames, people, 2)."""
    people: Sequence[tuple[Person, Kit, float]]
    """Players, with their kits and the phases of their steps in radians."""
    teams: Sequence[str] = ()
    """Those of the players, of `TEAMS`."""

    @classmethod
    def random(cls, field: Field, seed: int, cameras: Sequence[Camera]) -> Scene:
        """Make a scene whose players follow the play, at which the cameras of all frames aim."""
        rng = np.random.default_rng((seed, PEOPLE))
        kits = [random_kit(rng) for _ in TEAM_SHARES]
        people, teams = [], []
        for _ in range(PLAYERS):
            person, team = Person.random(rng), int(rng.choice(len(kits), p=TEAM_SHARES))
            people.append((person, kits[team], rng.uniform(0.0, 2.0 * np.pi)))
            teams.append(TEAMS[team])
        return cls(field, seed, RATE, _runs(field, cameras, rng), people, teams)

    def at(self, frame: int, camera: Camera) -> Float32:
        """Render the picture at the moment of a frame, (height, width, 3)."""
        view = GroundView.of(camera)
        light = random_light(view.ground, self.field, self._rng(LIGHT))
        picture = random_ground(view.ground, self.field, self._rng(GROUND)) * light
        boards = _boards(self.seed, frame / self.rate)
        add_surroundings(picture, view, self.field, self._rng(STANDS), boards)
        image = to_uint8(picture)
        self._add_objects(image, light, frame, camera)
        return image.astype(np.float32)

    def boxes(self, frame: int, camera: Camera) -> dict[int, Array]:
        """Boxes (left, top, right, bottom) of the players whose feet are in the picture, by their numbers.

        As a detector's, they count from the corner of the first pixel (`fieldcalib.io.boxes`).
        """
        X = np.pad(self.positions[frame], ((0, 0), (0, 1)))
        tall = np.array([person.tall for person, _, _ in self.people])
        feet, heads = camera.project(X), camera.project(X - tall[:, None] * (0.0, 0.0, 1.0))
        half = BOX * (feet[:, 1] - heads[:, 1]) / 2.0
        boxes = np.column_stack([feet[:, 0] - half, heads[:, 1], feet[:, 0] + half, feet[:, 1]]) + 0.5
        inside = np.all((feet >= 0.0) & (feet < camera.image_size), axis=1) & (camera.depth(X) > NEAREST)
        return {int(who): boxes[who] for who in np.flatnonzero(inside)}

    def _add_objects(self, image: Image, light: Float32, frame: int, camera: Camera) -> None:
        rng = self._rng(GOALS)
        suns, goals = random_suns(rng), random_goals(rng)
        first, last = max(frame - 1, 0), min(frame + 1, len(self.positions) - 1)
        velocity = (self.positions[last] - self.positions[first]) / max(last - first, 1)
        X = np.pad(self.positions[frame], ((0, 0), (0, 1)))
        share = np.minimum(np.linalg.norm(velocity, axis=1) * self.rate / SPRINT, 1.0)

        def draw(who: int) -> None:
            person, kit, phase = self.people[who]
            step = share[who] * np.sin(2.0 * np.pi * CADENCE * frame / self.rate + phase)
            heading = float(np.arctan2(velocity[who, 1], velocity[who, 0]))
            running = replace(person, stride=STRIDE * step, swing=SWING * step, heading=heading)
            add_person(image, light, camera, X[who], running, kit, suns)

        people = [Drawable(place, partial(draw, who)) for who, place in enumerate(X)]
        add_far_to_near(camera, [*people, *soccer_goals(image, camera, self.field, *goals)])

    def _rng(self, what: int) -> np.random.Generator:
        return np.random.default_rng((self.seed, what))


def clip_frames(
    seed: int,
    frames: int,
    cuts: int = 0,
    measured: MeasuredZoom | None = None,
    image_size: tuple[int, int] = CLIP_SIZE,
    *,
    flies: bool = False,
) -> list[TrueFrame]:
    """The cameras of a clip with `cuts` between the main camera and one beside it; both keep moving all the time.

    The main camera may fly along the side line (`data_tools.synthetic.paths.flight`).

    Examples
    --------
    >>> [frame.tripod for frame in clip_frames(0, 8, cuts=2)]
    [0, 0, 0, 1, 0, 0, 0, 0]
    """
    rng = np.random.default_rng((seed, CAMERAS))
    length = max(frames, LEAST_PATH)
    centre = flight(rng, length) if flies else None
    main = camera_path(rng, length, measured, centre=centre, image_size=image_size)
    other = camera_path(rng, length, centre=main[0].C + (BESIDE, 0.0, 0.0), image_size=image_size)
    cut = rng.choice(np.arange(1, frames), size=cuts, replace=False)
    shots = np.sum(np.arange(frames)[:, None] >= cut, axis=1).tolist()
    return [TrueFrame((main, other)[shot % 2][index], shot, shot % 2) for index, shot in enumerate(shots)]


def film(scene: Scene, frames: Sequence[TrueFrame]) -> Iterator[Image]:
    """The frames of a clip, see `filmed`."""
    return (filmed(scene, frames, index) for index in range(len(frames)))


def filmed(scene: Scene, frames: Sequence[TrueFrame], index: int) -> Image:
    """A frame of a clip, with motion blur, graphics, blur of the optics, and noise."""
    frame = frames[index]
    before, after = (
        frames[other].camera if 0 <= other < len(frames) and frames[other].shot == frame.shot else None
        for other in (index - 1, index + 1)
    )
    picture = exposed(scene, index, before, frame.camera, after)
    cv2.GaussianBlur(picture, (0, 0), OPTICS, dst=picture)
    rng = np.random.default_rng((scene.seed, NOISE, index))
    picture += GRAIN * rng.standard_normal(picture.shape, dtype=np.float32)
    image: Image = np.clip(picture + 0.5, 0.0, 255.0).astype(np.uint8)
    add_graphics(image, np.random.default_rng((scene.seed, GRAPHICS)))
    return image


def exposed(scene: Scene, index: int, before: Camera | None, camera: Camera, after: Camera | None) -> Float32:
    """The average over the exposure, whose middle is the time of the frame.

    The camera moves at a constant speed, the mean of that from the frame before and to the frame after (of the only one
    where a shot begins or ends), so that the frame's own camera is the mean of the exposure. The image of a turning
    camera is warped independently of depth, so that one picture, with a rim, gives all instants. The motion of players
    during the exposure is left out: it blurs them by less than 0.1 m.
    """
    before, after = (
        before or camera_between(camera, after or camera, -1.0),
        after or camera_between(camera, before or camera, -1.0),
    )
    ahead = camera_between(after, camera_between(camera, before, -1.0), 0.5)  # one frame later at the mean speed
    speed = _image_motion(camera, ahead)  # px per frame
    shutter = min(SHUTTER, MOST_BLUR * camera.image_size[0] / max(speed, 1.0))
    blur = shutter * speed
    if blur < BLUR_STEP:
        return scene.at(index, camera)
    rim = int(np.ceil(blur)) + CELL
    width, height = camera.image_size
    wide = camera.cropped((-rim, -rim), (width + 2 * rim, height + 2 * rim))
    picture = scene.at(index, wide)
    total = np.zeros((height, width, 3), np.float32)
    count = int(np.ceil(blur / BLUR_STEP))
    for share in shutter * ((np.arange(count) + 0.5) / count - 0.5):
        instant = camera_between(camera, ahead, share)
        total += cv2.remap(picture, *_warp_maps(instant, wide), cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return total / np.float32(count)


def _warp_maps(camera: Camera, other: Camera) -> tuple[Float32, Float32]:
    """Pixels x and y of `other` that show the same infinitely far points as the pixels of `camera`, (height, width).

    Within cells they are interpolated linearly: the lens bends a cell by less than a hundredth of a pixel.
    """
    width, height = camera.image_size
    x, y = (np.arange(0, size + CELL, CELL) for size in (width, height))
    corners = seen_far_away(camera, other, np.stack(np.meshgrid(x, y), axis=-1)).astype(np.float32)
    u, v = np.meshgrid(*(np.arange(size, dtype=np.float32) / CELL for size in (width, height)))
    seen = np.asarray(cv2.remap(corners, u, v, cv2.INTER_LINEAR), np.float32)
    return seen[..., 0], seen[..., 1]


def write_clip(path: Path, scene: Scene, frames: Sequence[TrueFrame]) -> None:
    """Write the clip as an MP4 and its cameras beside it, ``.jsonl`` (`cameras_as_text`)."""
    with VideoWriter(path, scene.rate) as video:
        for image in film(scene, frames):
            video.write(image)
    write_text(path.with_suffix(TRUTH), cameras_as_text(scene, frames))


def cameras_as_text(scene: Scene, frames: Sequence[TrueFrame]) -> str:
    """The cameras of a clip, one a line.

    Each line is a camera as SoccerNet writes it (`fieldcalib.io.soccernet`), with the keys `frame`, `shot`, `tripod`,
    `image_size`, and the size of the field in metres, `field`; `fieldcalib.io.samples.read_cameras` reads them.
    """
    size = {"field": [scene.field.length, scene.field.width]}
    lines = []
    for index, frame in enumerate(frames):
        of_frame = {"frame": index, "shot": frame.shot, "tripod": frame.tripod, "image_size": frame.camera.image_size}
        lines.append(json.dumps({**of_frame, **size, **camera_to_record(frame.camera)}) + "\n")
    return "".join(lines)


def _image_motion(a: Camera, b: Camera) -> float:
    """Largest motion, from one camera to another, of the image of infinitely far points, pixels."""
    width, height = a.image_size
    xy = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height], [width / 2.0, height / 2.0]])
    return float(np.nanmax(np.linalg.norm(seen_far_away(a, b, xy) - xy, axis=1)))


def _runs(field: Field, cameras: Sequence[Camera], rng: np.random.Generator) -> Array:
    """Draw positions of the players, (frames, people, 2)."""
    from scipy.ndimage import gaussian_filter1d

    middle = np.array(cameras[0].image_size) / 2.0
    aims = np.nan_to_num([camera.image_to_field(middle)[:2] for camera in cameras])
    play = FOLLOWING * gaussian_filter1d(aims, LOOKING * RATE, axis=0, mode="nearest")
    width = WANDER_TIME * RATE
    wander = gaussian_filter1d(rng.standard_normal((len(cameras), PLAYERS, 2)), width, axis=0, mode="wrap")
    wander *= WANDER * np.sqrt(2.0 * np.sqrt(np.pi) * width)
    half = np.array([field.length, field.width]) / 2.0
    return np.asarray(np.clip(play[:, None] + rng.normal(size=(PLAYERS, 2)) * SPREAD + wander, -half, half))


@lru_cache(maxsize=2)
def _content(seed: int, number: int) -> Float32:
    return boards_texture(np.random.default_rng((seed, BOARDS, number)))


def _boards(seed: int, time: float) -> Float32:
    """Content of electronic boards at a time in seconds; every second content scrolls."""
    number = int(np.floor(time / BOARD_PERIOD))
    texture = _content(seed, max(number, 0))
    return np.roll(texture, round(BOARD_SPEED * time * BOARD_SCALE), axis=1) if number % 2 else texture
