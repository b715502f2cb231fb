"""State of a shot of a live video: its keyframes, solved together, and the cameras of frames that are tied to them.

    keyframes -> matches between them; labels in the newest one -> cameras of all of them, and shared parameters
    frame, keyframes -> camera of the frame

Functions go from one frozen value to the next. Problems and solutions can be pickled, as keyframes are solved in
another process.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, BoolArray, Float32
from fieldcalib.assess.findings import Status
from fieldcalib.assess.frame_table import STEP, Basis, FrameTable
from fieldcalib.assess.label_errors import is_contradicted, misfit
from fieldcalib.assess.paint_in_view import MarkingInView, contradiction, paint_confirms
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.assess.sequence_errors import OwnErrors, ground_errors
from fieldcalib.fields.field import Field, tolerance_of
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.background.keyframe_tracking import KeyframePair
from fieldcalib.images.clip.clip_problem import Cells, ClipProblem, calibrate_frames_alone, cells_of
from fieldcalib.images.clip.finished_clip import LEAST_LINES, picture_motion, pooled_widths
from fieldcalib.images.clip.keyframes import are_consistent, labels_of
from fieldcalib.images.from_images import How
from fieldcalib.images.paint.detected_lines import detected_lines, with_replaced
from fieldcalib.images.paint.line_profiles import Markings, profiles_along
from fieldcalib.images.paint.paint_evidence import BAND, Ridges, evidence_of, widths_by_marking, with_extents
from fieldcalib.io.image_files import Image
from fieldcalib.problem.compilation import compiled_module
from fieldcalib.problem.labelled_pixels import NO_PIXELS, PixelTable
from fieldcalib.problem.layout import FIELD_SIZE, LOG_F, PAN, PRINCIPAL_POINT, ROLL, TILT, GaussianPrior, Layout
from fieldcalib.solve.sequence.background_matches import Ties, stepped, with_tied
from fieldcalib.solve.sequence.sequence_problem import (
    SharedParameters,
    SolvedFrames,
    solved_rows,
    table_without_cameras,
)
from fieldcalib.solve.sequence.sequence_solver import solve_from_cameras, solve_sequence, with_frames_alone
from fieldcalib.solve.solver_options import pixel_unit

MOST_KEYS, RECENT = 30, 12  # keyframes of a tripod that are solved together, and the last ones among them: 6 seconds
MOST_TRIPODS = 4  # earlier shots whose tripods are remembered
WIDTHS_EVERY, MOST_WIDTHS = 25, 20  # frames after which the width of the paint is measured again; measurements kept
LOST_AFTER = 8  # frames, a third of a second: if so many contradict their keyframes, the cameras are lost
FIRST_WIDTHS = 6  # first looks at the paint, each of which measures it: one frame tells its width badly
MOST_EXTRAPOLATED = 12  # successive untied frames whose camera is extrapolated: half a second


class FrameCamera(NamedTuple):
    """The camera of a frame to which other frames can be tied."""

    theta: Array
    """Parameters, (n,)."""
    errors: OwnErrors
    """Errors of one frame: own covariance E (o, o), and dependence F (o, S) on the shared parameters."""

    @classmethod
    def of(cls, frames: FrameTable, k: int = 0) -> FrameCamera:
        """Take the camera of row k of a table."""
        return cls(frames.theta[k], OwnErrors(frames.own[k], frames.following[k]))


@dataclass(frozen=True, eq=False)
class SolvedShot:
    """The keyframes of a shot, solved together."""

    shared: SharedParameters
    sequence: SequenceCalibration
    markings: Markings
    cameras: Mapping[int, FrameCamera]
    """Cameras of the keyframes that have one."""

    @property
    def layout(self) -> Layout:
        """Layout of the parameters of each camera."""
        return self.shared.options.layout


@dataclass(frozen=True, eq=False)
class SegmentedImage:
    """An image with its class probabilities; it stands in for the network that found them."""

    image: Image
    classes: tuple[str, ...]
    probabilities: Float32
    """Probabilities of the K classes, (1, K, h, w)."""

    def __call__(self, images: Sequence[Image]) -> Float32:
        """Return the stored probabilities, whatever the images."""
        return self.probabilities


@dataclass(frozen=True, eq=False)
class ShotProblem:
    """The problem of solving the keyframes of a shot after a new one has come."""

    problem: ClipProblem
    """The keyframes; labels are empty where no camera is found."""
    new: int
    """Number of the new keyframe."""
    pairs: Sequence[KeyframePair] = ()
    """Keyframes that are still to be matched."""
    layout: Layout | None = None
    """Layout of the parameters of cameras that are known already; None without any."""
    cameras: Mapping[int, Array] = field(default_factory=dict)
    """Parameters (n,) of these cameras."""
    tripods: Sequence[SolvedShot] = ()
    """Earlier shots, from whose tripods the new keyframe may have been taken as long as no camera is known."""


class ShotSolution(NamedTuple):
    """The result of solving the keyframes of a shot."""

    labels: Mapping[int, PixelTable]
    """Labels that the network found in the new keyframe, by its number; empty if they stay as they were."""
    matches: Mapping[tuple[int, int], Cells]
    """New matches between keyframes."""
    tried: Sequence[tuple[int, int]]
    """Pairs of keyframes that were to be matched, whether or not matches were found."""
    solved: SolvedShot | None
    """The solved keyframes; None as long as no keyframe has a camera."""
    tripod: int | None = None
    """Index of the earlier shot from whose tripod the new keyframe was taken; None if that is not known."""


def prepare(how: How) -> None:
    """Import what `solve_shot` needs, which takes longer than the first keyframe.

    `OtherProcess.run` calls it with an argument of `solve_shot`, and raises an error at once if this cannot be pickled.
    """
    import_module("scipy.spatial.transform")
    compiled_module()


def solve_shot(shot: ShotProblem, segmented: SegmentedImage | None) -> ShotSolution:
    """Match the pairs of keyframes, label the new keyframe if it was segmented, and solve all of them."""
    problem = shot.problem
    matches = {
        pair.indices: cells
        for pair in shot.pairs
        if (found := pair.matches()) is not None and (cells := cells_of(found, problem.image_size)) is not None
    }
    labels = {}
    if segmented is not None:
        (keyframe,) = labels_of(calibrate_frames_alone(replace(problem.how, network=segmented), [segmented.image]))
        if keyframe is not None and keyframe.accepted:
            labels = {shot.new: keyframe.labels}
    problem = replace(problem, labels={**problem.labels, **labels}, matches={**problem.matches, **matches})
    tried = [pair.indices for pair in shot.pairs]
    if labels and shot.layout is None:
        for number, earlier in enumerate(shot.tripods):
            if (solved := _on_tripod(problem, shot.new, earlier)) is not None:
                return ShotSolution(labels, matches, tried, solved, number)
    return ShotSolution(labels, matches, tried, _solved(problem, shot.layout, shot.cameras))


def _on_tripod(problem: ClipProblem, new: int, earlier: SolvedShot) -> SolvedShot | None:
    """Calibrate a keyframe on the tripod of an earlier shot, by its labels; None if they contradict that tripod."""
    shared = earlier.shared
    alone = replace(problem, frames=[new]).from_zero.calibrate_alone(np.zeros(1, dtype=np.intp), shared.options)
    solved = alone[0].solved if alone and alone[0].accepted else None
    if solved is None:
        return None
    evaluation = solved.evaluation.take(np.array([solved.frame]))
    if not are_consistent(evaluation) or is_contradicted(misfit(evaluation), problem.image_size)[0]:
        return None
    frames = with_frames_alone(table_without_cameras(shared, 1), shared, alone, None)
    sequence = replace(earlier.sequence, frames=frames)
    return replace(earlier, sequence=sequence, cameras={new: FrameCamera.of(frames)})


def _solved(problem: ClipProblem, layout: Layout | None, cameras: Mapping[int, Array]) -> SolvedShot | None:
    if layout is None:
        sequence, shared = solve_sequence(problem.from_zero)
    else:
        number = {key: k for k, key in enumerate(problem.frames)}
        known_cameras = {number[key]: theta for key, theta in cameras.items()}
        sequence, shared = solve_from_cameras(problem.from_zero, layout, known_cameras)
    if shared is None or not np.any(sequence.usable):
        return None
    known = {key: FrameCamera.of(sequence.frames, k) for k, key in enumerate(problem.frames) if sequence.usable[k]}
    return SolvedShot(shared, sequence, Markings.of(shared.object_segments), known)


@dataclass(frozen=True, eq=False)
class FollowedFrame:
    """The result of calibrating a frame from the keyframes it is tied to."""

    calibration: Calibration
    basis: Basis = Basis.NOTHING
    lines: PixelTable = NO_PIXELS
    """The lines in the frame."""
    camera: FrameCamera | None = None
    """Camera to which further frames can be tied; None if this frame itself is not tied."""
    markings: tuple[MarkingInView, ...] | None = None
    """Paint at the markings in view; None if it was not looked for."""
    is_moved: bool = False
    """Whether the camera was moved onto paint that lay beside its markings: the keyframes it is tied to are off too."""
    theta: Array | None = None
    """Parameters (n,) of the camera; None without one."""


@dataclass(frozen=True, eq=False)
class LiveShot:
    """The keyframes of a shot so far, and what is known of their cameras."""

    identity: int = 0
    """Number of the shot, or of the part of a shot since its cameras were lost."""
    piece: int = 0
    """Number of its piece (`TiedFrame`)."""
    count: int = 0
    """Number of its keyframes."""
    segmented: int = 0
    """Number of keyframes that the network has seen."""
    labels: Mapping[int, PixelTable] = field(default_factory=dict)
    """Lines in keyframes; empty where no camera is found."""
    matches: Mapping[tuple[int, int], Cells] = field(default_factory=dict)
    """Matches between keyframes."""
    pairs: Mapping[tuple[int, int], KeyframePair] = field(default_factory=dict)
    """Pairs of keyframes that are still to be matched."""
    solved: SolvedShot | None = None
    """The keyframes that were solved together last."""
    followed: Mapping[int, FrameCamera] = field(default_factory=dict)
    """Cameras of keyframes that are not solved yet, or were moved since; they are calibrated from solved ones."""
    last: tuple[tuple[int, FrameCamera], ...] = ()
    """The last two tied frames, from which the motion is extrapolated."""
    paint: tuple[int, tuple[MarkingInView, ...]] | None = None
    """Number of the last frame in which paint was looked for, and the markings seen there."""
    is_new: bool = False
    """Whether the paint has not been looked for since the keyframes were solved."""
    widths: tuple[tuple[int, Mapping[str, Array]], ...] = ()
    """Numbers of the last frames in which the width of the paint was measured, and these widths by marking."""

    sure: int = -1
    """Number of the last frame that showed its paint where its camera has it; -1 without any."""
    doubts: int = 0
    """Number of frames since then whose paint or matches contradict their keyframes."""
    tripod: int | None = None
    """Identity of the earlier shot whose tripod it is from; None if that is not known."""
    pitch: Field | None = None
    """The field, of the size and with the ground that earlier shots determined; None if they did not."""

    @property
    def is_lost(self) -> bool:
        """Whether so much has contradicted the cameras that the place is to be found again."""
        return self.doubts >= LOST_AFTER

    @property
    def is_beside(self) -> bool:
        """Whether a marking lay beside its paint when that was looked for last."""
        return self.paint is not None and any(one.is_beside for one in self.paint[1])

    @property
    def known(self) -> dict[int, FrameCamera]:
        """Cameras of all keyframes that have one."""
        return {**(self.solved.cameras if self.solved is not None else {}), **self.followed}

    def with_keyframe(
        self, index: int, ties: Mapping[int, Cells], pairs: Sequence[KeyframePair], found: FollowedFrame | None
    ) -> LiveShot:
        """Add a new keyframe, tied to earlier ones, with its camera if it has one."""
        camera = None if found is None else found.camera
        shot = replace(
            self,
            count=self.count + 1,
            labels={**self.labels, index: NO_PIXELS if found is None else found.lines},
            matches={**self.matches, **{(key, index): cells for key, cells in ties.items()}},
            pairs={**self.pairs, **{pair.indices: pair for pair in pairs}},
            followed=self.followed if camera is None else {**self.followed, index: camera},
        )
        return shot._with_keys(shot._kept)

    @property
    def _kept(self) -> list[int]:
        """Keyframes that are kept: the last ones, and of those before some that look in directions far apart."""
        keys, known = sorted(self.labels), self.known
        pan = {key: known[key].theta[PAN] for key in keys[:-RECENT] if key in known and self.labels[key].has_pixels[0]}
        order = sorted(pan, key=lambda key: pan[key])
        while len(order) > MOST_KEYS - RECENT:
            gaps = [pan[after] - pan[before] for before, after in zip(order[:-2], order[2:], strict=True)]
            del order[1 + int(np.argmin(gaps))]
        return sorted(order) + keys[-RECENT:]

    def _with_keys(self, keys: Sequence[int]) -> LiveShot:
        """Keep some of the keyframes only."""
        kept = set(keys)
        return replace(
            self,
            labels={key: self.labels[key] for key in keys},
            matches={pair: cells for pair, cells in self.matches.items() if kept >= set(pair)},
            pairs={pair: one for pair, one in self.pairs.items() if kept >= set(pair)},
            followed={key: one for key, one in self.followed.items() if key in kept},
        )

    @property
    def is_sure(self) -> bool:
        """Whether the paint has confirmed its cameras."""
        return self.solved is not None and self.sure >= 0

    @property
    def told(self) -> Field | None:
        """The field, of the size and with the ground that its keyframes determine; None if they do not."""
        names = () if self.solved is None else self.solved.sequence.names
        return self.solved.sequence.field if self.solved is not None and set(FIELD_SIZE) <= set(names) else self.pitch

    @property
    def remembered(self) -> LiveShot:
        """The shot without what came after its cameras were sure for the last time, if they are lost."""
        return self._with_keys([key for key in sorted(self.labels) if key <= self.sure]) if self.is_lost else self

    def problem(self, how: How, image_size: tuple[int, int], new: int, tripods: Sequence[LiveShot] = ()) -> ShotProblem:
        """Set up the problem to be solved when a new keyframe has come, maybe from the tripod of an earlier shot."""
        if self.pitch is not None:
            how = replace(how, task=replace(how.task, object_segments=self.pitch))
        return ShotProblem(
            ClipProblem(how, image_size, sorted(self.labels), self.labels, self.matches),
            new,
            tuple(self.pairs.values()),
            None if self.solved is None else self.solved.layout,
            {key: one.theta for key, one in self.known.items() if key in self.labels},
            tuple(one.solved for one in tripods if one.solved is not None) if self.solved is None else (),
        )

    def with_solution(self, solution: ShotSolution, tripods: Sequence[LiveShot] = ()) -> LiveShot:
        """Take over the solution of a `problem`; keyframes that came in the meantime are calibrated from it."""
        if solution.tripod is not None:
            return self._on_tripod_of(tripods[solution.tripod]).with_solution(solution._replace(tripod=None))
        labels = {key: one for key, one in {**self.labels, **solution.labels}.items() if key in self.labels}
        pairs = {pair: one for pair, one in self.pairs.items() if pair not in solution.tried}
        shot = replace(self, labels=labels, matches={**self.matches, **solution.matches}, pairs=pairs)
        if solution.solved is None:
            return shot
        cameras = solution.solved.cameras
        followed = {key: one for key, one in self.known.items() if key not in cameras and key in labels}
        shot = replace(shot, solved=solution.solved, followed=followed, is_new=True)
        for key in sorted(key for key in labels if key > max(cameras) and key not in followed):
            ties = {i: cells for (i, j), cells in shot.matches.items() if j == key and i in shot.known}
            found = _tied(shot, solution.solved, ties, None) if ties else None
            if found is not None:
                shot = replace(shot, followed={**shot.followed, key: FrameCamera.of(found[0])})
        return shot

    def _on_tripod_of(self, earlier: LiveShot) -> LiveShot:
        """Join the shot to an earlier one from the same tripod, whose keyframes are solved together with its own."""
        return replace(
            self,
            labels={**earlier.labels, **self.labels},
            matches={**earlier.matches, **self.matches},
            followed={**earlier.known, **self.followed},
            tripod=earlier.identity,
            pitch=earlier.pitch,
            count=earlier.count + self.count,
        )

    def with_paint(self, index: int, image: Image, camera: Camera, markings: Sequence[MarkingInView]) -> LiveShot:
        """Remember the paint that a frame shows at the markings in view, and at times measure its width."""
        shot = self
        is_due = len(self.widths) < FIRST_WIDTHS or index - self.widths[-1][0] >= WIDTHS_EVERY
        if self.solved is not None and is_due:
            profiles = profiles_along(camera, self.solved.markings)
            measured = index, widths_by_marking(image, profiles, self.solved.markings)
            shot = replace(shot, widths=(*self.widths[1 - MOST_WIDTHS :], measured))
        markings = with_extents(markings, pooled_widths([one for _, one in shot.widths]))
        shot = replace(shot, paint=(index, markings), is_new=False)
        if contradiction(markings):
            return replace(shot, doubts=self.doubts + 1)
        return replace(shot, doubts=0, sure=index if any(one.is_confirmed for one in markings) else self.sure)

    def with_frame(self, index: int, found: FollowedFrame, ties: Mapping[int, Cells]) -> LiveShot:
        """Remember the camera of the newest frame; if it was moved onto its paint, the keyframes it is tied to move."""
        if found.camera is None:
            return replace(self, doubts=self.doubts + 1) if ties and found.theta is None else self
        shot = replace(self, last=(*self.last[-1:], (index, found.camera)))
        if not found.is_moved or self.solved is None:
            return shot
        alone = replace(self, followed={index: found.camera}, solved=replace(self.solved, cameras={}), last=())
        moved = {
            key: FrameCamera.of(tied[0])
            for key, (p, q) in ties.items()
            if (tied := _tied(alone, self.solved, {index: (q, p)}, None)) is not None
        }
        labels = {**self.labels, **dict.fromkeys(moved, NO_PIXELS)}
        return replace(shot, labels=labels, followed={**self.followed, **moved})


def follow(
    shot: LiveShot, solved: SolvedShot, index: int, image: Image, ties: Mapping[int, Cells], *, on_paint: bool
) -> FollowedFrame:
    """Calibrate an image from the keyframes that it is tied to, or from the motion of the frames before.

    With `on_paint` the paint of all markings in view is looked for, and a camera that lies beside it is moved onto it.
    """
    found = _from_keyframes(shot, solved, index, image, ties)
    return _on_paint(shot, solved, index, image, found) if on_paint and found.theta is not None else found


def _from_keyframes(
    shot: LiveShot, solved: SolvedShot, index: int, image: Image, ties: Mapping[int, Cells]
) -> FollowedFrame:
    """Calibrate an image without looking for paint beside its markings."""
    known = shot.known
    keys = sorted(key for key in ties if key in known)
    if index in known:  # a keyframe that has been solved by now
        return _placed(solved, known[index], Basis.LINES)
    if not keys:
        camera = _extrapolated(shot.last, index, solved.layout.free)
        if camera is None:
            return _without_camera("nothing ties this frame to a keyframe that has a camera")
        if not _shows_lines(image, solved.layout.camera(camera.theta), solved.markings):
            return _without_camera(
                "nothing ties this frame, and it shows no lines where the camera should have them: a cut?"
            )
        return _placed(solved, camera, Basis.INTERPOLATED)
    found = _tied(shot, solved, {key: ties[key] for key in keys}, image)
    if found is None:
        return _without_camera("the matches of this frame contradict its keyframes")
    row, lines = found
    return _of_only_frame(solved, row, lines, FrameCamera.of(row))


def _on_paint(shot: LiveShot, solved: SolvedShot, index: int, image: Image, found: FollowedFrame) -> FollowedFrame:
    """Look for the paint of all markings; move the camera onto paint beside them if less then lies beside.

    A frame that nothing ties must then show paint along several markings.
    """
    assert found.theta is not None
    theta = found.theta[None]
    shared, markings, camera = solved.shared, solved.markings, solved.layout.camera(found.theta)
    ridges, motion = Ridges.of(image, profiles_along(camera, markings)), np.zeros(2)
    if shot.last:
        before, other = shot.last[-1]
        motion = picture_motion(camera, solved.layout.camera(other.theta)) / max(index - before, 1)
    seen = evidence_of(ridges, markings, motion)
    found = replace(found, markings=seen.markings, lines=with_replaced(found.lines, seen.beside))
    if not seen.beside.has_pixels.any():
        return found
    moved = shared.solved(theta, found.lines, None, _near(solved.layout, theta))
    row = solved_rows(shared, SolvedFrames(moved, shared.errors(moved), np.array([False])))
    again = evidence_of(ridges.seen_by(solved.layout.camera(row.theta[0]), markings), markings, motion)
    is_safe = found.camera is not None or paint_confirms(again.markings)
    if _beside(again.markings) >= _beside(seen.markings) or not is_safe:
        return found
    own = FrameCamera.of(row)
    return replace(_of_only_frame(solved, row, found.lines, own), markings=again.markings, is_moved=True)


def _beside(markings: Sequence[MarkingInView]) -> float:
    """Number of places at which the image shows paint beside a marking instead of on it."""
    return sum((1.0 - one.share) * one.places for one in markings if one.is_beside)


def _near(layout: Layout, theta: Array) -> GaussianPrior:
    """Prior for cameras near theta (B, n) that are off by as much as paint is looked for beside their markings."""
    reach = BAND * pixel_unit(layout.image_size)
    sigma = np.full_like(theta, np.inf)
    sigma[:, [PAN, TILT]] = reach / np.exp(theta[:, [LOG_F]])
    sigma[:, [ROLL, LOG_F]] = 2.0 * reach / layout.image_size[0]
    sigma[:, PRINCIPAL_POINT] = reach
    return GaussianPrior(theta, sigma)


def _tied(
    shot: LiveShot, solved: SolvedShot, ties: Mapping[int, Cells], image: Image | None
) -> tuple[FrameTable, PixelTable] | None:
    """Solve a frame from the keyframes `ties` and its lines; returns both, None if its matches contradict these."""
    known = shot.known
    keys, shared, layout = sorted(ties), solved.shared, solved.layout
    here, is_known = np.array([len(keys)]), np.arange(len(keys) + 1) < len(keys)
    pairs = {(k, len(keys)): ties[key] for k, key in enumerate(keys)}
    local = Ties.of(shared.options.object_segments, pairs, len(keys) + 1, layout.image_size)
    near = image is not None and bool(shot.last)
    last = shot.last[-1][1] if near else known[keys[-1]]
    # rows are the known keyframes and, last, the frame itself: it starts at the camera of the last tied frame, from
    # which one Gauss-Newton step mostly suffices, or at the nearest keyframe
    alike = next(iter(solved.cameras.values())).theta  # what is not free is alike in all cameras
    theta = np.where(layout.free, [*(known[key].theta for key in keys), last.theta], alike)
    towards = local.towards(here, theta, is_known)
    if near:
        theta[-1:], (contradicted,) = stepped(towards, layout, theta[-1:])
    if not near or contradicted:  # or the last tied frame is long ago, and looked elsewhere
        theta, reached = with_tied(shared.options, local, theta, is_known, here, layout)
        if not reached[-1]:
            return None
    lines, markings = NO_PIXELS, solved.markings
    if image is not None:
        lines = detected_lines(image, profiles_along(layout.camera(theta[-1]), markings), markings)
    of_keys = [known[keys[k]].errors for k in towards.first.tolist()]
    of_first = OwnErrors(*(np.array(part) for part in zip(*of_keys, strict=True)))
    followed = shared.solved(theta[-1:], lines, towards, shared.prior(theta[-1:]))
    return solved_rows(shared, SolvedFrames(followed, shared.errors(followed, of_first), np.array([True]))), lines


def _placed(solved: SolvedShot, camera: FrameCamera, basis: Basis) -> FollowedFrame:
    """Result for a frame whose camera is known already."""
    shared, theta, errors = solved.shared, camera.theta[None], OwnErrors(*(part[None] for part in camera.errors))
    metres = ground_errors(theta, errors, shared.considered, shared.options.field)
    tolerance = tolerance_of(shared.options.field)
    row = table_without_cameras(shared, 1).with_cameras(theta, errors, metres, basis, tolerance)
    return _of_only_frame(solved, row)


def _of_only_frame(
    solved: SolvedShot, row: FrameTable, lines: PixelTable = NO_PIXELS, camera: FrameCamera | None = None
) -> FollowedFrame:
    sequence = replace(solved.sequence, frames=row)
    return FollowedFrame(sequence[0], sequence.basis[0], lines, camera, theta=row.theta[0])


def _without_camera(message: str) -> FollowedFrame:
    return FollowedFrame(Calibration.without_camera(Status.TOO_FEW_SEGMENTS, message))


def _shows_lines(image: Image, camera: Camera, markings: Markings) -> bool:
    """Whether enough of the markings in view have a line in the image."""
    profiles = profiles_along(camera, markings)
    lines = detected_lines(image, profiles, markings, np.inf)
    return len(lines.frame) >= LEAST_LINES * max(len(profiles), 1)


def _extrapolated(last: Sequence[tuple[int, FrameCamera]], index: int, free: BoolArray) -> FrameCamera | None:
    """Extrapolate the motion of the last two tied frames, with growing errors; None after half a second."""
    if not last or index - last[-1][0] > MOST_EXTRAPOLATED:
        return None
    (before, other), (t, camera) = last[0], last[-1]
    gap = index - t
    motion = np.zeros_like(camera.theta) if t == before else (camera.theta - other.theta) / (t - before)
    spread = gap * (0.5 * np.abs(motion[free]) + STEP * gap)
    errors = camera.errors._replace(own=camera.errors.own + np.diag(np.square(spread)))
    return FrameCamera(camera.theta + gap * np.where(free, motion, 0.0), errors)
