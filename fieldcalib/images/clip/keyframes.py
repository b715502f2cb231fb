"""First pass over a part of a video: its shots, the matches between their frames, and the labels in keyframes.

The labels that the network finds in keyframes are also used to check the cameras from the joint solution ("witnesses").
Lines are looked for near the markings that a camera projects, so they can only confirm it: a line that lies elsewhere
is not found and contradicts nothing. The labels of the network were found without that camera and can contradict it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as attribute

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.label_errors import LEAST_FRAMES, misfit, rms_by_label
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.fields.field import Field, ObjectSegments
from fieldcalib.images.background.keyframe_tracking import KeyframeTracker, TiedFrame
from fieldcalib.images.clip.clip_models import Pieces, loose_at_end, numbered
from fieldcalib.images.clip.clip_problem import Cells, ClipProblem, calibrate_frames_alone, cells_of
from fieldcalib.images.from_images import LEAST_SEGMENTS, How
from fieldcalib.images.paint.detected_lines import line_loss
from fieldcalib.images.search.court_search import search_courts
from fieldcalib.images.search.place_search import Place, place_of, search_from
from fieldcalib.images.shape.enlarged import Detail, softness_of_shot
from fieldcalib.images.shape.shape_of_picture import as_part
from fieldcalib.io.image_files import IMAGES_AT_ONCE, Image, size_of
from fieldcalib.problem.evaluation import Evaluation, Problem, evaluate
from fieldcalib.problem.labelled_pixels import PixelTable
from fieldcalib.problem.layout import Layout
from fieldcalib.problem.observations import Observations
from fieldcalib.problem.picture_shape import is_whole_shape
from fieldcalib.solve.sequence.sequence_solver import calibrate_one_by_one, solve_sequence
from fieldcalib.solve.solver_options import pixel_unit

EXTRA_OFFSETS = (4, 8)  # frames after a keyframe that the network sees too until a keyframe of the piece is accepted
BARE = 7  # frames of a piece that the network has seen, all with too few labels, after which it is left,
GLANCE = 24  # and frames from one to the next that it sees of such a piece, most of which are close-ups
MOST_EXTRA = 6  # such frames of a piece: most pieces without a camera show no field
EXPLAINED = 6.0  # px of 960 x 540: right cameras of nine clips have every label of their keyframes within 3 px
LEAST_CONSISTENT = 4  # labels that a camera must explain: any fewer are explained by some camera, wherever they lie
LEAST_WITHOUT_WORST = 6  # labels of a keyframe from which the worst is left out: a board may pass for a touchline

MOST_REFUSED = 40  # keyframes without a court that are kept, to be searched again once the place is known


@dataclass(frozen=True, eq=False)
class Shots:
    """The pieces of a part of a video, and the matches between their frames."""

    begin: int
    """Number of the first frame in the video; in this part frames are numbered from 0."""
    image_size: tuple[int, int]
    pieces: Pieces
    loose: BoolArray
    """Whether each frame is untied, and at the end of its shot, (T,); such frames make pieces of their own."""
    matches: Mapping[tuple[int, int], Cells]
    """Matches by the numbers of the keyframe and of the other frame."""


@dataclass(frozen=True, eq=False)
class Keyframes:
    """Shots, with the labels that a network found in their keyframes, and in some other frames."""

    how: How
    shots: Shots
    labels: Mapping[int, KeyframeLabels]
    details: Mapping[int, Detail] = attribute(default_factory=dict)
    """Evidence that frames were enlarged, by keyframe; of some only."""
    sized: Mapping[int, Field] = attribute(default_factory=dict)
    """The field of pieces that take its size from other ones."""

    @property
    def accepted(self) -> dict[int, PixelTable]:
        """Labels of keyframes whose camera was accepted."""
        return {t: one.labels for t, one in self.labels.items() if one.accepted}

    @property
    def doubtful(self) -> dict[int, PixelTable]:
        """Labels of keyframes whose camera was not accepted."""
        return {t: one.labels for t, one in self.labels.items() if not one.accepted}

    def softness(self, frames: IntArray) -> float:
        """Softness of the keyframes among some frames (`softness_of_shot`), evidence that they were enlarged."""
        return softness_of_shot([self.details[t] for t in frames.tolist() if t in self.details])

    def calibrate(
        self,
        pieces: Pieces,
        members: Sequence[int],
        labels: Mapping[int, PixelTable],
        start: SequenceCalibration | None = None,
        left_out: Collection[tuple[int, int]] = (),
    ) -> SequenceCalibration:
        """Calibrate all frames of some pieces, from the lines in some frames and from matches that are not left out.

        Labels of keyframes that contradict their cameras increase the misfit (`with_witnesses`).
        """
        how, size = self.how, self.shots.image_size
        frames, model = pieces.frames(members).tolist(), pieces.model_of(members)
        if model.is_window == is_whole_shape(size):  # narrow windows tell by their motion how wide the frame is
            how = replace(how, task=as_part(how.task, size))
        if all(piece in self.sized for piece in members):
            how = replace(how, task=replace(how.task, object_segments=self.sized[members[0]]))
        matches = {pair: cells for pair, cells in self.shots.matches.items() if pair not in left_out}
        problem = ClipProblem(replace(how, not_shared=model.not_shared), size, frames, labels, matches).from_zero
        calibration = calibrate_one_by_one(problem) if model.is_alone else solve_sequence(problem, start).calibration
        witnesses = witnesses_of(self.labels, frames, calibration)
        return with_witnesses(how.task.object_segments, calibration, witnesses)


def read_keyframes(
    frames: Iterable[tuple[Image, TiedFrame]], how: How, begin: int = 0, tracker: KeyframeTracker | None = None
) -> Keyframes:
    """Read the frames of a part of a video once; the network sees keyframes, and some others of unsure pieces.

    Frames are numbered from the first one, whose number in the video is `begin`. The `tracker` that ties them is told
    to leave pieces that show no markings. Without a network the court is searched for in these frames: in each alone
    until some give a camera, then from the place of their tripod. In the end the frames without a camera are searched
    again from there.
    """
    size = 0, 0
    piece: list[int] = []
    linked: list[bool] = []
    matches: dict[tuple[int, int], Cells] = {}
    labels: dict[int, KeyframeLabels] = {}
    details: dict[int, Detail] = {}
    waiting: dict[int, Image] = {}  # frames that the network is to see
    searched = SearchedKeyframes(how)
    bare: dict[int, float] = {}  # number of frames of a piece that the network has seen; -inf if one had labels
    last = 0  # the last of them
    extra: dict[int, int] = {}  # frames between keyframes that the network may still see, by piece

    def look() -> None:
        nonlocal searched
        if how.network is None:
            searched = searched.searched(waiting)
            found = labels_of([searched.found[t] for t in waiting if t in searched.found])
            seen = [t for t in waiting if t in searched.found]
        else:
            alone = calibrate_frames_alone(how, list(waiting.values()))
            seen, found = list(waiting), labels_of(alone)
            for t, one in zip(waiting, alone, strict=True):
                bare[piece[t]] = bare.get(piece[t], 0) + 1 if len(one.pixel_counts) < LEAST_SEGMENTS else -np.inf
        if how.may_be_enlarged:
            details.update({t: Detail.of(image) for t, image in waiting.items()})
        labels.update({t: one for t, one in zip(seen, found, strict=True) if one is not None})
        waiting.clear()

    for t, (image, tied) in enumerate(frames):
        if t == 0:
            size = size_of(image)
        piece.append(tied.piece)
        linked.append(tied.is_key or bool(tied.ties) or tied.is_passed)
        ties = {(key, t): cells for key, found in tied.ties if (cells := cells_of(found, size)) is not None}
        matches |= ties
        unsure = not any(one.accepted and piece[key] == tied.piece for key, one in labels.items())
        is_extra = unsure and extra.get(tied.piece, 0) > 0 and tied.index - tied.key in EXTRA_OFFSETS
        is_due = tied.is_key or not ties or is_extra
        if (
            t - last >= GLANCE if tied.is_passed else is_due
        ):  # an untied frame can only be calibrated from its own labels
            waiting[t] = image
            extra[tied.piece] = extra.get(tied.piece, MOST_EXTRA) - is_extra
            if len(waiting) == IMAGES_AT_ONCE or unsure:
                look()
            last = t
        if tracker is not None and bare.get(tied.piece, 0) >= BARE:
            tracker.leave(tied.piece)
        elif tied.is_passed and tracker is not None:
            tracker.begin_anew()
    look()
    again = searched.searched_again().found
    labels |= {t: one for t, one in zip(again, labels_of(list(again.values())), strict=True) if one is not None}
    labels = dict(sorted(labels.items()))
    loose = loose_at_end(piece, linked)
    pieces = Pieces(np.array(numbered(piece, loose), dtype=np.intp))
    return Keyframes(how, Shots(begin, size, pieces, np.array(loose, dtype=bool), matches), labels, details)


@dataclass(frozen=True, eq=False)
class KeyframeLabels:
    """Labels of a keyframe to which a camera was fitted, and how well it explains them."""

    labels: PixelTable
    accepted: bool = True
    """Whether that camera was accepted; if not, the labels are doubtful."""
    consistent: bool = True
    """Whether that camera explains enough of the labels."""


def labels_of(calibrations: Sequence[Calibration]) -> list[KeyframeLabels | None]:
    """Take the labels of keyframes that were calibrated as single images; None where no camera could be fitted."""
    return [
        None
        if one.solved is None
        else KeyframeLabels(one.solved.pixels, one.accepted, are_consistent(one.solved.alone.evaluation))
        for one in calibrations
    ]


def are_consistent(evaluation: Evaluation) -> bool:
    """Whether the camera of one frame explains at least four of its labels, and at least half of them.

    Otherwise the labels contradict one another, as in narrow pictures without corners.
    """
    (by_label,) = rms_by_label(evaluation)
    by_label = by_label[np.isfinite(by_label)]
    explained = int(np.count_nonzero(by_label < EXPLAINED * pixel_unit(evaluation.problem.layout.image_size)))
    return explained >= max(LEAST_CONSISTENT, 0.5 * len(by_label))


def witnesses_of(
    keyframes: Mapping[int, KeyframeLabels], frames: Sequence[int], calibration: SequenceCalibration
) -> dict[int, KeyframeLabels]:
    """Labels of keyframes by which cameras are checked, by position in `frames`, for those that have a camera.

    Labels that contradict one another are left out if enough keyframes were accepted by themselves.
    """
    found = {k: keyframes[t] for k, t in enumerate(frames) if t in keyframes}
    enough = sum(one.accepted for one in found.values()) >= LEAST_FRAMES
    usable = calibration.usable
    return {
        k: one
        for k, one in found.items()
        if usable[k] and one.labels.has_pixels.any() and (one.accepted or one.consistent or not enough)
    }


def with_witnesses(
    object_segments: ObjectSegments, calibration: SequenceCalibration, witnesses: Mapping[int, KeyframeLabels]
) -> SequenceCalibration:
    """Raise the misfit of frames to that of the labels of keyframes, where this is larger.

    It is interpolated between keyframes. Each keyframe's misfit is limited to the larger one of its two neighbours'.
    Labels of keyframes that were accepted by themselves agree with one another; their misfit is as in
    `fieldcalib.assess.label_errors`. Of other keyframes a camera need only explain half of the labels; if it explains
    fewer, the misfit is the median distance of the labels.
    """
    if not witnesses or calibration.layout is None:
        return calibration
    frames = np.array(sorted(witnesses), dtype=np.intp)
    segments = object_segments if calibration.field is None else calibration.field
    keyframes = [witnesses[t] for t in frames.tolist()]
    excess = _excess(segments, keyframes, calibration.layout, calibration.frames.theta[frames])
    between = np.interp(np.arange(len(calibration)), frames, _confirmed(excess))
    has_camera = np.isfinite(calibration.frames.theta).all(axis=1)
    found = np.where(has_camera, np.fmax(calibration.frames.misfit, between), np.nan)
    return replace(calibration, frames=replace(calibration.frames, misfit=found))


def _excess(
    object_segments: ObjectSegments, keyframes: Sequence[KeyframeLabels], layout: Layout, theta: Array
) -> Array:
    """Misfit (B,), in pixels, of the labels of keyframes under cameras theta (B, n), without each one's worst label."""
    pixels = PixelTable.joined(object_segments, [one.labels for one in keyframes])
    observations = Observations.of(object_segments, pixels, layout.image_size)
    all_labels = evaluate(Problem(observations, layout, line_loss(layout.image_size)), theta)
    rms, table = rms_by_label(all_labels), observations.pixels
    worst = np.where(np.sum(np.isfinite(rms), axis=1) >= LEAST_WITHOUT_WORST, np.nanargmax(rms, axis=1), -1)
    others = observations.relabelled(np.where(table.label == worst[table.frame], -1, table.label))
    evaluation = evaluate(replace(all_labels.problem, observations=others), theta)
    rms = rms_by_label(evaluation)
    labelled = np.isfinite(rms)
    explained = np.sum(labelled & (rms < EXPLAINED * pixel_unit(layout.image_size)), axis=1)
    off = np.where(explained < 0.5 * np.sum(labelled, axis=1), np.nanmedian(rms, axis=1), 0.0)
    return np.where([one.accepted for one in keyframes], misfit(evaluation), off)


def _confirmed(excess: Array) -> Array:
    """Limit each misfit to the larger of its two neighbours', as in one keyframe of forty labels lie beside paint."""
    if len(excess) < 2:
        return np.zeros_like(excess)
    before, after = np.concatenate([[0.0], excess[:-1]]), np.concatenate([excess[1:], [0.0]])
    return np.asarray(np.minimum(excess, np.maximum(before, after)))


@dataclass(frozen=True, eq=False)
class SearchedKeyframes:
    """Keyframes that were searched for a court, by their numbers."""

    how: How
    found: Mapping[int, Calibration] = attribute(default_factory=dict)
    """Accepted cameras."""
    refused: Mapping[int, Image] = attribute(default_factory=dict)
    """Images in which no court was found."""

    @property
    def place(self) -> Place | None:
        """Place of the tripod; None if it is not known, or the camera moves."""
        field = self.how.task.field
        if field is None or not self.how.is_on_tripod:
            return None
        return place_of(list(self.found.values()))

    def searched(self, images: Mapping[int, Image]) -> SearchedKeyframes:
        """Search further keyframes from the place of the tripod, if it is known; if that fails, from anywhere."""
        after = self
        for t, image in images.items():
            calibration = after._from_place(image) or search_courts(after.how.task, [image])[0]
            if calibration.accepted:
                after = replace(after, found={**after.found, t: calibration})
            elif len(after.refused) < MOST_REFUSED:
                after = replace(after, refused={**after.refused, t: image})
        return after

    def searched_again(self) -> SearchedKeyframes:
        """Search the refused keyframes again, from the place of the accepted ones."""
        again = {t: self._from_place(image) for t, image in self.refused.items()}
        return replace(
            self, found={**self.found, **{t: one for t, one in again.items() if one is not None}}, refused={}
        )

    def _from_place(self, image: Image) -> Calibration | None:
        """An accepted camera at the place of the tripod; None if there is none."""
        place, field = self.place, self.how.task.field
        if place is None or field is None:
            return None
        found = search_from(self.how.task, field, image, place)
        return found if found.accepted else None
