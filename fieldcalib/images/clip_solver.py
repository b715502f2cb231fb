"""The frames of a video while they are calibrated: what is read from them, and the shots and tripods that they make."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.assess.markings import MarkingInView
from fieldcalib.assess.misfit import LEAST_FRAMES, is_contradicted, is_of_wrong_model
from fieldcalib.assess.misfit import LEAST_SHARE as LEAST_CONTRADICTED
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.assess.video import NO_TRIPOD, Shot, VideoCalibration
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.images.clip_models import (
    LeftOut,
    Misprediction,
    Model,
    Said,
    is_taken,
    of_window,
    parts,
    said_of_frames_alone,
    said_of_misfit,
    said_of_motion,
    said_of_parts,
    said_of_window,
)
from fieldcalib.images.frame_lines import as_given, frame_lines, with_paint
from fieldcalib.images.frames_together import Cells, cells_of, problem_of_lines
from fieldcalib.images.from_images import calibrate_frames_alone
from fieldcalib.images.hypotheses import NO_MARKING
from fieldcalib.images.keyframes import Tied
from fieldcalib.images.line_profiles import Markings
from fieldcalib.images.matches import Matches
from fieldcalib.images.paint_evidence import Ridges, evidence_of
from fieldcalib.images.same_tripod import grouped
from fieldcalib.images.witnesses import agree, with_witnesses, witnessed_misfit
from fieldcalib.io.image import Image
from fieldcalib.io.images import IMAGES_AT_ONCE
from fieldcalib.localize import Network
from fieldcalib.localize.padding import Padded
from fieldcalib.problem.layout import PRINCIPAL_POINT
from fieldcalib.problem.prior import is_whole_shape
from fieldcalib.problem.projection import Projection
from fieldcalib.solve.centres import nearest_places
from fieldcalib.solve.from_segments import NO_PIXELS
from fieldcalib.solve.given_camera import NOTHING_GIVEN, GivenCamera
from fieldcalib.solve.joint_problem import labels_of
from fieldcalib.solve.options import CalibrationFlags, Prior
from fieldcalib.solve.sequence_solver import calibrate_one_by_one, solve_sequence
from fieldcalib.solve.tripod import Labels

LONGEST_GAP = 25  # frames without a camera in a row that are interpolated: a second
BETWEEN = (4, 8)  # frames after a keyframe that the network sees too while no keyframe of the piece is accepted,
MOST_MORE = 6  # and how many of these: most pieces without a camera show no field
PAINT_EVERY = 5  # frames, besides keyframes, in which paint beside the markings is looked for
MIXED = "the picture may be mixed with that of another camera"
LEAST_SHARE = 0.2  # of the profiles of a shot must show a line where its cameras have markings


@dataclass
class TripodOfClip:
    """Pieces of a video from one tripod."""

    pieces: list[int]
    calibration: SequenceCalibration
    """Of their frames, in order."""


class ClipSolver:
    """The frames of a video while they are calibrated."""

    def __init__(
        self,
        object_segments: ObjectSegments,
        flags: int,
        prior: Prior,
        shared: Sequence[str],
        given: GivenCamera = NOTHING_GIVEN,
    ) -> None:
        self.object_segments = object_segments
        self.shared = shared
        self.flags = flags
        self.prior = prior
        self.given = given
        self.size = (0, 0)
        self.begin = 0  # number of the first frame in the video
        self.piece: list[int] = []  # of each frame
        self.linked: list[bool] = []  # whether something ties each frame to its piece
        self.in_transition: list[bool] = []  # whether each frame is one that nothing ties after all others of its piece
        self.matches: dict[tuple[int, int], Cells] = {}
        self.seen: dict[int, Labels] = {}  # in keyframes whose camera was accepted
        self.doubtful: dict[int, Labels] = {}  # in the others,
        self.garbled: set[int] = set()  # and those of these whose labels no camera explains together
        self.moving: frozenset[int] = frozenset()  # pieces whose camera is found to move,
        self.windows: frozenset[int] = frozenset()  # those that are a window which moves,
        self.alone: frozenset[int] = frozenset()  # and those whose frames share nothing
        self.network: Network | None = None  # by which it is read
        self.notes: list[str] = []  # what was found of the camera beyond that

    @property
    def pieces(self) -> list[int]:
        """Their numbers."""
        return sorted(set(self.piece))

    def frames(self, pieces: Sequence[int]) -> IntArray:
        """The frames of some pieces, in order."""
        return np.flatnonzero(np.isin(self.piece, pieces))

    def read(self, frames: Iterable[tuple[Image, Tied]], network: Network) -> None:
        """Matches of all frames, and the markings that are found in keyframes, and in some others of unsure pieces.

        Frames are numbered from the first one; what ties them to frames before it is left out.
        """
        first: int | None = None
        keys: list[int] = []
        held: list[Image] = []
        self.network = Padded(network)  # pixels of clips are square

        def look() -> None:
            for key, calibration in zip(keys, self._by_themselves(held), strict=True):
                if calibration.solved is not None:
                    alone = calibration.solved.alone.evaluation
                    (self.seen if calibration.accepted else self.doubtful)[key] = as_given(labels_of(alone))
                    if not calibration.accepted and not agree(alone):
                        self.garbled.add(key)
            keys.clear()
            held.clear()

        more: dict[int, int] = {}  # looks that pieces have left
        for image, tied in frames:
            first = self.begin = tied.index if first is None else first
            index = tied.index - first
            self.size = image.shape[1], image.shape[0]
            self.piece.append(tied.piece)
            self.linked.append(tied.is_key or bool(tied.ties))
            found = {key - first: self.cells(key - first, index, matches) for key, matches in tied.ties if key >= first}
            ties = {(key, index): cells for key, cells in found.items() if cells is not None}
            self.matches.update(ties)
            unsure = tied.piece not in {self.piece[key] for key in self.seen}
            soon = unsure and more.get(tied.piece, 0) > 0 and tied.index - tied.key in BETWEEN
            if tied.is_key or not ties or soon:  # what nothing ties must tell its camera by itself
                keys.append(index)
                held.append(image)
                more[tied.piece] = more.get(tied.piece, MOST_MORE) - soon
                if len(held) == IMAGES_AT_ONCE or unsure:
                    look()
        look()
        self.in_transition = at_end_of_piece(self.piece, self.linked)
        self.piece = numbered(self.piece, self.in_transition)

    def _by_themselves(self, images: Sequence[Image]) -> list[Calibration]:
        """Images as single ones."""
        assert self.network is not None
        return calibrate_frames_alone(
            self.object_segments, images, self.network, flags=self.flags, prior=self.prior, given=self.given
        )

    def cells(self, key: int, index: int, matches: Matches) -> Cells | None:
        """What is kept of the matches from a keyframe to a frame; None if they tie nothing."""
        return cells_of(matches, self.size)

    def together(
        self,
        pieces: Sequence[int],
        lines: Mapping[int, Labels],
        start: SequenceCalibration | None = None,
        left_out: Collection[tuple[int, int]] = (),
    ) -> SequenceCalibration:
        """All frames of some pieces, from the lines in some of them and from matches, but for those left out."""
        frames = self.frames(pieces).tolist()
        is_window = not self.windows.isdisjoint(pieces)
        not_shared = "centre" if self.moving.issuperset(pieces) else "principal point" if is_window else ""
        problem = problem_of_lines(
            self.object_segments,
            frames,
            lines,
            {pair: cells for pair, cells in self.matches.items() if pair not in left_out},
            self.size,
            flags=self.flags,
            prior=of_window(self.prior, self.object_segments, self.size) if is_window else self.prior,
            shared=tuple(name for name in self.shared if name != not_shared),
            given=self.given,
        )
        if self.alone.issuperset(pieces):
            calibration = calibrate_one_by_one(problem)
        else:
            calibration = solve_sequence(problem, start).calibration
        return with_witnesses(calibration, *self._witnessed(pieces, calibration))

    def _witnessed(self, pieces: Sequence[int], calibration: SequenceCalibration) -> tuple[IntArray, Array]:
        """How far the cameras of some pieces contradict what was seen in keyframes; frames are numbered from 0.

        Labels that contradict one another do not count where others tell enough of the place of the camera.
        """
        number = {frame: k for k, frame in enumerate(self.frames(pieces).tolist())}
        seen = {number[t]: labels for t, labels in self.seen.items() if t in number}
        spared = self.garbled if len(seen) >= LEAST_FRAMES else set()
        doubtful = {number[t]: labels for t, labels in self.doubtful.items() if t in number and t not in spared}
        return witnessed_misfit(self.object_segments, calibration, seen, doubtful)

    def _shots(self) -> dict[int, SequenceCalibration]:
        """Each piece by itself; those that one place does not explain in parts, or from a camera that moves."""
        self._join_transitions()
        shots: dict[int, SequenceCalibration] = {}
        while left := [piece for piece in self.pieces if piece > max(shots, default=-1)]:
            shots |= self._explained(left[0])
        return shots

    def _join_transitions(self) -> None:
        """Let frames that nothing ties at the end of a piece belong to it, unless they show what contradicts it."""
        told = {self.piece[t] for t in self.seen}
        for piece in sorted({p for p, is_loose in zip(self.piece, self.in_transition, strict=False) if is_loose})[::-1]:
            if piece not in told or (piece - 1 in told and self._belongs(piece)):
                self.piece = [number - (number >= piece) for number in self.piece]

    def _belongs(self, piece: int) -> bool:
        """Whether one place explains what is seen in a piece and in the one before."""
        frames = self.frames([piece - 1, piece])
        found = self.together([piece - 1, piece], self.seen)
        wrong = is_contradicted(found.frames.misfit, self.size) | ~found.usable
        labelled, is_own = np.isin(frames, list(self.seen)), np.array(self.piece)[frames] == piece
        return not np.any(wrong[labelled & is_own]) and bool(np.mean(wrong[labelled & ~is_own]) < LEAST_CONTRADICTED)

    def _explained(self, piece: int) -> dict[int, SequenceCalibration]:
        """A piece, or the parts that it is divided into: their numbers begin with its own."""
        shots = {piece: self.together([piece], self.seen)}
        frames, labels = self.frames([piece]), {t: one for t, one in self.seen.items() if self.piece[t] == piece}
        keyframes, excess = self._witnessed([piece], shots[piece])
        excess = np.fmax(excess, shots[piece].frames.misfit[keyframes])
        is_wrong = len(labels) >= LEAST_FRAMES and is_of_wrong_model(excess, self.size)
        is_free = "centre" in self.shared and not self.flags & CalibrationFlags.CALIB_FIX_POSITION
        if not is_free or not shots[piece].together or not (is_wrong or not is_whole_shape(self.size)):
            return shots
        first: list[list[int]] = []
        if is_wrong:
            first = [parts(frames[keyframes], is_contradicted(excess, self.size)), self._parts_of_two_places(piece)]
        left_out = LeftOut.of(labels, self._between_keyframes(piece))
        before = Model(self.piece, self.moving, self.windows, self.alone)
        at_one_place = best = self._misprediction(left_out, shots)
        notes = [said_of_misfit(self.begin + frames)] if is_wrong else []
        found, model = shots, before
        for said, where, tried in self._other_models(before, piece, first, is_wrong):
            self.piece, self.moving, self.windows, self.alone = tried
            members = range(piece, piece + 1 + max(self.piece) - max(before.piece))
            others = {p: self.together([p], self.seen) for p in members}
            if not any(one.together for one in others.values()) and said is not said_of_frames_alone:
                continue
            score = self._misprediction(left_out, others)
            if is_taken(said, score, best, at_one_place):
                best, found, model = score, others, tried
                notes = [said(self.begin + where, at_one_place, score)]
        self.piece, self.moving, self.windows, self.alone = model
        self.notes += notes
        return found

    def _other_models(
        self, before: Model, piece: int, first: Sequence[Sequence[int]], is_wrong: bool
    ) -> Iterator[tuple[Said, IntArray, Model]]:
        """What else may hold for a piece, and what is said of which frames then; the simplest one first.

        `first` are the keyframes before which it may be divided into parts.
        """
        frames = self.frames([piece])
        lets_move = self.prior is not None and not self.flags & CalibrationFlags.CALIB_FIX_PRINCIPAL_POINT
        if lets_move and self.given.camera_matrix is None:
            yield said_of_window, frames, before._replace(windows=before.windows | {piece})
        for k, some in enumerate(first):
            if some and some not in first[:k]:
                part = np.searchsorted(some, np.arange(len(before.piece)), "right")
                yield said_of_parts, np.array(some), before._replace(piece=(np.array(before.piece) + part).tolist())
        if is_wrong:
            yield said_of_motion, frames, before._replace(moving=before.moving | {piece})
        if is_wrong and self.network is not None:
            yield said_of_frames_alone, frames, before._replace(alone=before.alone | {piece})

    def _parts_of_two_places(self, piece: int) -> list[int]:
        """First keyframes of the parts whose single frames stand nearer to one or to the other of two places."""
        before, self.alone = self.alone, self.alone | {piece}
        by_themselves = self.together([piece], self.seen)
        self.alone = before
        keyframes = np.flatnonzero(by_themselves.accepted)
        return parts(
            self.frames([piece])[keyframes], nearest_places([by_themselves[k] for k in keyframes.tolist()]) > 0
        )

    def _between_keyframes(self, piece: int) -> dict[tuple[int, int], Cells]:
        """Matches of the keyframes of a piece with one another."""
        keys = {key for key, _ in self.matches}
        return {pair: one for pair, one in self.matches.items() if pair[1] in keys and self.piece[pair[1]] == piece}

    def _misprediction(self, left_out: LeftOut, shots: Mapping[int, SequenceCalibration]) -> Misprediction:
        """That of labels and matches left out, by shots that are solved again without them."""
        found = [(self.frames([p]), self.together([p], left_out.kept, one, left_out.pairs)) for p, one in shots.items()]
        return left_out.misprediction(self.object_segments, found)

    def tripods(self) -> list[TripodOfClip]:
        """The tripods of the pieces, the one with most frames first."""
        shots = self._shots()
        stands = "centre" in self.shared
        found_pieces = [piece for piece, shot in shots.items() if shot.together]
        if stands and self.flags & CalibrationFlags.CALIB_FIX_POSITION:  # one place, as the user says
            groups = [found_pieces] if found_pieces else []
        elif stands:
            groups = grouped({piece: shot for piece, shot in shots.items() if piece not in self.moving})
        else:
            groups = [[piece] for piece in found_pieces]
        groups += [[piece] for piece in found_pieces if piece in self.moving]
        groups += [[piece] for piece in shots if piece in self.alone]
        found = self._agreeing(groups, shots)
        found.sort(key=lambda tripod: -len(tripod.calibration))
        if stands:
            self._join_the_others(found)
        return found

    def _agreeing(self, groups: Sequence[list[int]], shots: Mapping[int, SequenceCalibration]) -> list[TripodOfClip]:
        """The tripods of groups of pieces, without pieces that have another camera after all: these make others.

        A piece that hardly tells a place joins any group; with its own lines the others then contradict it.
        """
        found, left = [], list(groups)
        while left:
            pieces = left.pop(0)
            calibration = shots[pieces[0]] if len(pieces) == 1 else self.together(pieces, self.seen)
            others = self._contradicted(pieces, calibration, shots)
            if others:
                rest = [piece for piece in pieces if piece not in others]
                left += [rest, *grouped({piece: shots[piece] for piece in others})]
            else:
                found.append(TripodOfClip(pieces, calibration))
        return found

    def _contradicted(
        self, pieces: Sequence[int], calibration: SequenceCalibration, shots: Mapping[int, SequenceCalibration]
    ) -> list[int]:
        """Pieces whose lines are brought off by what they share, and are not by themselves; never all of them."""
        if len(pieces) == 1 or self.flags & CalibrationFlags.CALIB_FIX_POSITION:
            return []
        piece = np.array(self.piece)[self.frames(pieces)]
        excess = {p: calibration.frames.misfit[piece == p] for p in pieces}
        wrong = [
            p
            for p in pieces
            if is_of_wrong_model(excess[p], self.size) and not is_of_wrong_model(shots[p].frames.misfit, self.size)
        ]
        return wrong if len(wrong) < len(pieces) else [max(wrong, key=lambda p: float(np.nanmedian(excess[p])))]

    def _join_the_others(self, tripods: list[TripodOfClip]) -> None:
        """Pieces that tell no place by themselves, with the tripod from which they show what was found in them."""
        for tripod in tripods:
            if self.alone.issuperset(tripod.pieces):
                continue
            others = [p for p in self.pieces if not any(p in one.pieces for one in tripods)]
            frames = set(self.frames(others).tolist())
            doubtful = {t: lines for t, lines in self.doubtful.items() if t in frames}
            if not doubtful:
                return
            pieces = sorted([*tripod.pieces, *{self.piece[t] for t in doubtful}])
            calibration = self.together(pieces, {**self.seen, **doubtful})
            members = self.frames(pieces)
            accepted = calibration.accepted
            fitting = [p for p in pieces if np.any(accepted[np.array(self.piece)[members] == p])]
            if set(fitting) > set(tripod.pieces):
                tripod.pieces, tripod.calibration = fitting, self.together(fitting, {**self.seen, **doubtful})

    def lines_in(
        self, images: Iterable[Image], tripods: Sequence[TripodOfClip]
    ) -> tuple[dict[int, Labels], dict[int, Ridges]]:
        """The lines at the projected markings of every frame, and the ridges beside those of some frames.

        What is paint beside markings is among the lines of these frames. Tripods lose pieces that show hardly any line.
        """
        cameras, markings, of_object = {}, [], Markings.of(self.object_segments)
        for tripod in tripods:
            field = tripod.calibration.field
            markings.append(of_object if field is None else Markings.of(field))
            for t, calibration in zip(self.frames(tripod.pieces).tolist(), tripod.calibration, strict=True):
                cameras[t] = calibration, markings[-1]
        lines: dict[int, Labels] = {}
        ridges: dict[int, Ridges] = {}
        keys = {key for key, _ in self.matches}
        count = np.zeros((2, 1 + max(self.piece, default=0)))  # of profiles with a line and of all, by piece
        for t, image in enumerate(images):
            if self.piece[t] in self.alone:
                (by_itself,) = self._by_themselves([image])
                if by_itself.camera is not None and by_itself.solved is not None:
                    lines[t] = as_given(labels_of(by_itself.solved.alone.evaluation))
                    ridges[t] = Ridges.of(image, by_itself.camera, of_object)
                    count[:, self.piece[t]] += 1.0
                continue
            if t not in cameras:
                continue
            calibration, of_field = cameras.pop(t)
            if calibration.camera is None:
                continue
            lines[t], profiles = frame_lines(image, calibration.camera, of_field, _shift_sigma(calibration))
            if t in keys or t % PAINT_EVERY == 0:
                ridges[t] = Ridges.of(image, calibration.camera, of_field)
                lines[t] = with_paint(lines[t], evidence_of(ridges[t], of_field).beside)
            count[:, self.piece[t]] += sum(map(len, lines[t][0].values())), profiles
        share = count[0] / np.maximum(count[1], 1.0)
        for tripod in tripods:
            tripod.pieces = [p for p in tripod.pieces if share[p] >= LEAST_SHARE]
        return lines, ridges

    def finished(
        self, tripods: Sequence[TripodOfClip], lines: Mapping[int, Labels], ridges: Mapping[int, Ridges]
    ) -> VideoCalibration:
        """All frames of every tripod, from the lines in them; ridges beside their markings speak against cameras."""
        tripod, number = np.full(len(self.piece), NO_TRIPOD), np.zeros(len(self.piece), dtype=np.intp)
        calibrations: list[SequenceCalibration] = []
        for one in tripods:
            if not one.pieces:
                continue
            frames = self.frames(one.pieces)
            tripod[frames], number[frames] = len(calibrations), np.arange(len(frames))
            before = one.calibration if len(one.calibration) == len(frames) else None
            calibration = self.together(one.pieces, lines, before)
            if not self.alone.issuperset(one.pieces):
                calibration = calibration.interpolated(np.array(self.piece)[frames], LONGEST_GAP)
            calibration = calibration.with_notes({NO_PIXELS: f"{NO_MARKING}, and no frame around it tells its camera"})
            calibrations.append(calibration.seen_in_images(self._paint(calibration, frames, ridges)))
        for t in self._mixed(tripod):
            if tripod[t] != NO_TRIPOD:
                calibrations[tripod[t]] = calibrations[tripod[t]].doubted({int(number[t]): MIXED})
        shots = [(frames[0], frames[-1] + 1) for p in self.pieces if len(frames := self.frames([p]))]
        return VideoCalibration(
            tuple(calibrations),
            tuple(Shot(int(start), int(stop), int(tripod[start])) for start, stop in shots),
            tripod,
            number,
            tuple(self.notes),
        )

    def _mixed(self, tripod: IntArray) -> list[int]:
        """Frames between those of two cameras that nothing ties; the tripod (T,) of each frame is known."""
        loose = np.array(self.in_transition, dtype=bool)
        edges = np.flatnonzero(np.diff(loose, prepend=False, append=False)).tolist()
        runs = [range(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b < len(loose)]
        return [t for run in runs if tripod[run.start - 1] != tripod[run.stop] for t in run]

    def looked_at_again(
        self, found: VideoCalibration, tripods: Sequence[TripodOfClip], images: Iterable[Image]
    ) -> VideoCalibration:
        """All frames once more, from lines near the markings of their cameras, if more of these lie on paint then."""
        members = [tripod for tripod in tripods if tripod.pieces]
        again = [TripodOfClip(one.pieces, found.tripods[k]) for k, one in enumerate(members)]
        second = self.finished(again, *self.lines_in(images, again))
        return second if _cameras(second) >= _cameras(found) and off_paint(second) < off_paint(found) else found

    def _paint(
        self, calibration: SequenceCalibration, frames: IntArray, ridges: Mapping[int, Ridges]
    ) -> dict[int, tuple[MarkingInView, ...]]:
        """What frames of a tripod show of their markings, by their numbers in it: of others it is as of the nearest."""
        field = calibration.field
        markings = Markings.of(self.object_segments if field is None else field)
        seen: dict[int, tuple[MarkingInView, ...]] = {}
        for k, t in enumerate(frames.tolist()):
            camera = calibration[k].camera
            if t in ridges and camera is not None:
                seen[k] = evidence_of(ridges[t].seen_by(camera, markings), markings).markings
        if not seen:
            return {}
        looked_at = np.array(sorted(seen))
        piece, found = np.array(self.piece)[frames], {}
        for k in range(len(frames)):
            near = int(looked_at[np.argmin(np.abs(frames[looked_at] - frames[k]))])
            if abs(frames[near] - frames[k]) < PAINT_EVERY and piece[near] == piece[k]:
                found[k] = seen[near]
        return found


def at_end_of_piece(piece: Sequence[int], linked: Sequence[bool]) -> list[bool]:
    """Which frames nothing ties, nor one after them in their piece: of a dissolve, or of a pan too fast to follow.

    They may show the next camera: what is seen in them says nothing of the frames before.

    Parameters
    ----------
    piece : (T,) sequence of int
        Ascending.
    linked : (T,) sequence of bool
        Whether something ties a frame to its piece; the first frame of a piece is tied to it.

    Examples
    --------
    >>> at_end_of_piece([0, 0, 0, 0, 3, 3], [True, False, True, False, True, True])
    [False, False, False, True, False, False]
    """
    last = {p: t for t, (p, is_linked) in enumerate(zip(piece, linked, strict=True)) if is_linked}
    return [t > last[p] for t, p in enumerate(piece)]


def numbered(piece: Sequence[int], apart: Sequence[bool]) -> list[int]:
    """Numbers of pieces from 0, with some of their frames apart.

    Examples
    --------
    >>> numbered([0, 0, 0, 0, 3, 3], [False, False, False, True, False, False])
    [0, 0, 0, 1, 2, 2]
    """
    both = list(zip(piece, apart, strict=True))
    return list(accumulate((one != other for one, other in pairwise(both)), initial=0))[: len(both)]


def _shift_sigma(calibration: Calibration) -> float:
    """Standard deviation of where the picture as a whole lies, pixels.

    Where a window moves, the turn of the camera and the shift of the window are known much worse than both together.
    """
    assert calibration.camera is not None
    errors, f = calibration.uncertainty.if_level, calibration.camera.focal_length
    layout = errors.layout
    if not np.any(layout.free[PRINCIPAL_POINT]):
        return float(f * np.sqrt(np.max(np.diagonal(errors.covariance)[:2])))
    projection = Projection(errors.theta[None], layout)
    middle = np.divide(layout.image_size, 2.0).reshape(1, 1, 2).repeat(2, axis=1)
    s = projection.ideal_offset(projection.observed_offset(middle))
    (J,) = projection.derivatives(s, np.zeros((1, 2)), np.eye(2)[:, None], np.ones(layout.size, dtype=bool))
    return float(np.sqrt(np.max(np.diagonal(J.T @ errors.covariance @ J))))


def off_paint(video: VideoCalibration) -> float:
    """Share of the frames with a camera in which a marking lies beside its paint; 0 without any."""
    off = [any(one.is_beside for one in seen) for tripod in video.tripods for seen in tripod.frames.markings.values()]
    return sum(off) / max(_cameras(video), 1)


def _cameras(video: VideoCalibration) -> int:
    """Number of frames with a camera."""
    return sum(int(np.count_nonzero(tripod.usable)) for tripod in video.tripods)
