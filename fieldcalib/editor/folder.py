"""The folder of an editor: its results and journal are read when it is opened, and labels and cameras are saved there.

A save is announced in the journal before its files are moved to their places, and noted as done afterwards. A save that
could not be finished, or whose process has ended in between, is finished before the next one.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from threading import Thread

from fieldcalib._types import expect, file_path, listed
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.draw.overlays import draw_calibration
from fieldcalib.editor.clip import AGAIN, Progress, Proposal, draw_again
from fieldcalib.editor.edit import Edit, History
from fieldcalib.editor.frame import FrameEditor
from fieldcalib.editor.frame_states import FrameState, FrameStates, Row, basis_of, is_by_hand
from fieldcalib.editor.journal import NOTHING_WRITTEN, FrameHistory, Journal, Replayed, Unfinished
from fieldcalib.editor.label_files import SOCCERNET, GivenLabels, label_file, label_files, saved_files, soccernet_file
from fieldcalib.editor.label_versions import Announce, Announced
from fieldcalib.editor.saved_files import LastSave, NewRun, Saved, Stored, source_of
from fieldcalib.fields.catalogue import FIELDS
from fieldcalib.fields.catalogue import field as field_by_name
from fieldcalib.fields.field import Field
from fieldcalib.io.annotations import Annotation
from fieldcalib.io.field_files import is_field_file, read_field
from fieldcalib.io.files import FrameFile
from fieldcalib.io.formats import IMAGES, OVERLAYS, VIDEOS
from fieldcalib.io.frame_source import ArrayFrames, FileFrames, FrameSource, VideoFrames, ignored
from fieldcalib.io.image_files import Image, checked_image

AT_ONCE = 5000  # rows of the table that are read before the page is shown; more are read in a thread
NOTHING_KEPT = "expected a solution that was kept last: since then something else was saved, or nothing"


def places_of(
    source: str | os.PathLike[str] | Sequence[Image], out: str | os.PathLike[str] | None
) -> tuple[list[Path] | None, Path | None]:
    """Find the paths of the pictures or of the video, None for arrays, and the folder of results, if there is one."""
    folder = None if out is None else file_path(out, "a folder of results")
    if not isinstance(source, str | os.PathLike):
        return None, folder
    path = file_path(source, "a picture, a folder, a video or results of a run")
    if not path.exists():
        raise FileNotFoundError(f"{path} does not exist: expected a picture, a folder, a video or results of a run")
    if path.is_dir() and Stored.has_results(path):
        return source_of(path), path if folder is None else folder
    return [path], file_path(_beside(path), "a folder of results") if folder is None else folder


def _beside(path: Path) -> Path:
    """The folder of results beside a file or folder, named after it."""
    named = path if path.name not in ("", "..") else path.resolve()  # "." has no name
    if not named.name:
        raise ValueError(f"expected out, a folder of results: {path} has no name after which to call one beside it")
    return named.with_name(f"{named.stem if named.is_file() else named.name}-fieldcalib")


def frames_of(source: object, paths: list[Path] | None, stored: Stored | None) -> FrameSource:
    """Open the frames of arrays, of files, or of a video, of which a run may have used a part."""
    if paths is None:
        return ArrayFrames([checked_image(image) for image in listed(source, "a path or pictures")])
    if VIDEOS.recognises(paths[0]):
        of_run = stored is not None and not stored.is_begun_here  # a run may be of a part of the video
        numbers = [int(id) for id in stored.ids if id.isdecimal()] if stored is not None and of_run else []
        return VideoFrames(paths[0], tell=ignored, numbers=numbers or None)
    files: list[FrameFile] = IMAGES.find(paths)
    pictures = FileFrames(files, tell=ignored)
    if len(files) == 1 and files[0].path == paths[0]:  # raises if broken; of a folder, the page says which files are
        pictures.image(0)
    return pictures


def field_of(field: Field | str | None, stored: Stored | None) -> tuple[Field, str]:
    """Find the field and its name."""
    if isinstance(field, Field):
        return field, "field"
    if field is not None:
        expect(field, str, '"soccer"')
    record = None if stored is None or field is not None else stored.record
    name = field or (record is not None and record.options.get("field")) or "soccer"
    if name in FIELDS or not is_field_file(name):
        return field_by_name(name), name
    return read_field(name), Path(name).stem


@dataclass(frozen=True)
class BeforeKeep:
    """The state of an editor before a solution of a clip was kept, to undo that."""

    proposal: Proposal
    states: Mapping[int, FrameState]
    rows: Sequence[Row]
    cuts: Sequence[int]
    saved: Sequence[int]
    """Numbers of the frames whose labels were saved with it."""
    saves: int = 0
    """The number of the save by which it was kept."""


class Folder:
    """The folder of an editor, with results and a journal.

    Parameters
    ----------
    stored : Stored
        The results, which may be empty.
    replayed : Replayed
        Contents of the journal.
    states : FrameStates
        States of the frames.
    given : GivenLabels
        Labels with which the editor begins.
    new : NewRun
        Values for the record, if no run has written one.

    Raises
    ------
    FileExistsError
        As `Stored.check_in_the_way`.
    """

    def __init__(
        self, stored: Stored, replayed: Replayed, states: FrameStates, given: GivenLabels, new: NewRun
    ) -> None:
        self.stored, self._states, self._new = stored, states, new
        self.journal = Journal(stored.folder, replayed.size)
        self.last_save = LastSave()
        """Report of the last save: the files that it replaced, and the frames that it left out."""
        self._unfinished = replayed.unfinished  # a save that was announced and could not be finished yet
        self._before_keep: BeforeKeep | None = None
        if stored.know(replayed.written):
            replayed.forget_saved()
        stored.check_in_the_way(states.frames.ids, given.files)
        self._label_format = given.format or replayed.format
        self._has_noted_format = self._label_format == replayed.format

    def calibration(self, number: int) -> Calibration | None:
        """The calibration of a frame in the results; None if there is none of this field."""
        return self._of_field(self.stored.calibration(self._id(number)))

    def base(self, number: int, edits: FrameHistory) -> Calibration | None:
        """Camera of a frame without labels by hand: that of the results if it is such, else that of the journal."""
        id = self._id(number)
        if id in self.stored and not is_by_hand(self.stored.basis(id)):
            return self.calibration(number)
        try:
            return None if edits.base is None else self._of_field(Calibration.from_dict(edits.base))
        except ValueError:  # written by another version, say: the camera is computed again
            return None

    def _of_field(self, calibration: Calibration | None) -> Calibration | None:
        """Pass a calibration on; None if it is of another field than the one opened, not only of another size."""
        field = self._states.field
        if calibration is None or calibration.field is None or calibration.field.keys() == field.keys():
            return calibration
        return None

    def _id(self, number: int) -> str:
        return self._states.frames.ids[number]

    def restore(self, frames: Mapping[str, FrameHistory]) -> None:
        """Restore the edits of frames from the journal, and their cameras."""
        numbers = self._states.numbers
        for number, edits in ((numbers[id], edits) for id, edits in frames.items() if id in numbers):
            state = FrameState(edits, self._states.spilled, has_begun=True, base=self.base(number, edits))
            self._states[number] = state
            edits.base = None
            self._show_saved(number)
            row = self._states.rows[number]
            self._states.rows[number] = row._replace(by_hand=not edits.history.present.automatic)

    def _show_saved(self, number: int) -> None:
        """Take over the saved camera of a clip's frame: it may be the clip's, not the one from its marks alone."""
        state = self._states[number]
        if self._states.is_clip and state.is_saved and is_by_hand(self.stored.basis(self._id(number))):
            saved = self.calibration(number)
            if saved is not None:
                state.keep(saved)

    def show_rows(self) -> None:
        """Fill the table from the results; with many frames this happens in a thread, while the table grows."""
        if len(self.stored.ids) <= AT_ONCE:
            self._fill_rows()
        else:
            Thread(target=self._fill_rows, name="rows", daemon=True).start()

    def _fill_rows(self) -> None:
        """Fill rows that are still empty from the results; rows that were shown since, by a new solution say, stay."""
        states = self._states
        for count, (id, row) in enumerate(self.stored.rows(), 1):
            number = states.numbers.get(id)
            if number is not None and not states.rows[number].verdict:
                states.rows[number] = row._replace(by_hand=states.rows[number].by_hand)
            states.version += count % AT_ONCE == 0
        states.version += 1

    def note_change(self, number: int, after: History[Edit]) -> None:
        """Note in the journal that a frame is about to be changed.

        Raises
        ------
        OSError
            If the journal cannot be written.
        """
        state, id = self._states[number], self._id(number)
        before = state.edits.history
        if not state.has_begun:
            self.journal.begin(id, before.present, state.base)
            state.has_begun = True
        if state.touched().left_out:
            self.journal.add(frame=id, left_out=True)
            state.touched().left_out = 0
        self.journal.change(id, before, after)

    def save(self, fitted: Callable[[int], FrameEditor]) -> int:
        """Write frames as described for `Editor.save`, with the cameras from `fitted`; returns their number."""
        self.journal.open()
        with self._states.lock:
            self._go_on()
            numbers = [n for n, state in sorted(self._states.items()) if self._is_to_save(n, state)]
            saved: list[int] = []
            failed: dict[str, str] = {}
            frames = self._each_saved(numbers, fitted, saved, failed)
            more = self._label_files(numbers)
            cuts = self._states.cuts if self._states.has_own_cuts else None
            announce = self._announcing("saved", saved)
            self.stored.save(frames, self._states.frames.ids, self._new, announce, more=more, cuts=cuts)
            self._finish()
            self.last_save = LastSave(self.stored.replaced, failed)
        return len(saved)

    def _is_to_save(self, number: int, state: FrameState) -> bool:
        if not state.is_saved:
            return True
        return self._id(number) not in self.stored and (state.is_anchor or not state.is_to_search)

    def _each_saved(
        self, numbers: Sequence[int], fitted: Callable[[int], FrameEditor], saved: list[int], failed: dict[str, str]
    ) -> Iterator[Saved]:
        """Yield the frames to be saved; `saved` collects the numbers of those that can be, `failed` reasons by id."""
        for n in numbers:
            try:
                one = self._saved(n, fitted(n))
            except (ValueError, ArithmeticError) as error:
                failed[self._id(n)] = str(error)
                continue
            self._begin([n])
            saved.append(n)
            yield one

    def _saved(self, number: int, one: FrameEditor) -> Saved:
        """Collect a frame's calibration and the contents of its files."""
        id, calibration = self._id(number), one.calibration
        files = self._label_file(number)
        if not self._states.is_clip:
            drawn = draw_calibration(one.image, calibration, calibration.field or one.field)
            files[OVERLAYS.file_name(id)] = OVERLAYS.write(drawn)
        return Saved(id, calibration, self._states.rows[number].basis, files)

    def keep(self, proposal: Proposal) -> int:
        """Accept a solution and write its cameras, as described for `Editor.keep`; returns their number."""
        self.journal.open()
        with self._states.lock:
            self._go_on()
            states, stored = self._states, self.stored
            frames = []
            for n, calibration in proposal.calibrations.items():
                is_anchor = n in proposal.anchors
                files = self._label_file(n) if is_anchor else {}
                basis = basis_of(states[n].edits.history.present.marks) if is_anchor else proposal.basis(n)
                frames.append(Saved(self._id(n), calibration, basis, files))
            more = self._label_files(sorted(proposal.anchors))
            saved = [n for n, revision in proposal.revisions.items() if states.revision(n) == revision]
            copies = {n: one.copy() for n, one in states.items()}
            before = BeforeKeep(proposal, copies, list(states.rows), list(states.cuts), saved)
            self._begin(saved)

            def done() -> None:
                self._before_keep = replace(before, saves=stored.saves)
                self._take(proposal)

            announce = self._announcing("saved", saved, done)
            stored.save(frames, states.frames.ids, self._new, announce, clip=self._whole(proposal), more=more)
            self._finish()
        return len(frames)

    def _whole(self, proposal: Proposal) -> VideoCalibration | None:
        """Combine a solution with the calibration of the rest of the clip; None if there is none."""
        (begin, end), ids = proposal.window, self._states.frames.ids
        if end - begin == len(ids):
            return proposal.whole(None, len(ids))
        outside = [id for n, id in enumerate(ids) if not begin <= n < end]
        mended = any(is_by_hand(self.stored.basis(id)) for id in outside)
        return proposal.whole(self.stored.clip(), len(ids), mended_outside=mended)

    def _take(self, proposal: Proposal) -> None:
        """Take over the cameras and the cuts of a solution, except for frames that were changed since."""
        states = self._states
        for n, calibration in proposal.calibrations.items():
            state = states.get(n)
            if state is None or not state.is_anchor:
                if state is not None:
                    state.base = calibration
                states.show(n, Row.of(calibration, proposal.basis(n)))
            elif proposal.revisions.get(n) == state.revision:
                state.keep(calibration)
                states.show(n, Row.of(calibration, states.rows[n].basis, by_hand=True))
        if not states.has_own_cuts:
            begin, end = proposal.window
            inside = (begin + shot.start for shot in proposal.video.shots)
            states.cuts = sorted({*inside, *(cut for cut in states.cuts if not begin <= cut < end)})
        states.version += 1

    @property
    def can_undo_keep(self) -> bool:
        """Whether the last save was a `keep`, which can be undone."""
        before = self._before_keep
        return before is not None and self.stored.saves == before.saves

    def undo_keep(self) -> Proposal:
        """Undo the last `keep`, as described for `Editor.undo_keep`; returns its solution."""
        before = self._before_keep
        if before is None or not self.can_undo_keep:
            raise ValueError(NOTHING_KEPT)
        self.journal.open()
        with self._states.lock:
            self._go_on()
            if self._before_keep is not None:  # `_go_on` may have completed an undo that was interrupted
                forget = partial(self._forget_keep, before)
                self.stored.take_back(self._announcing("taken_back", before.saved, forget))
                self._finish()
        return before.proposal

    def _forget_keep(self, before: BeforeKeep) -> None:
        """Restore the states from before a solution was kept, except what a person has changed since."""
        self._before_keep = None
        states = self._states
        for n, state in list(states.items()):
            if n in before.states:
                state.before(before.states[n])
            else:
                state.base = self.base(n, state.edits)
                state.found = None
        revisions = {n: state.revision for n, state in before.states.items()}
        changed = {n for n, state in states.items() if state.revision != revisions.get(n, 0)}
        states.rows = [states.rows[n] if n in changed else row for n, row in enumerate(before.rows)]
        if not states.has_own_cuts:
            states.cuts = list(before.cuts)
        states.version += 1

    @property
    def to_draw(self) -> list[str]:
        """Files of a clip that show older cameras, were moved to the history, and can be drawn again."""
        return [name for name in self.stored.moved if name in AGAIN] if self._states.is_clip else []

    def draw(self, progress: Progress) -> list[str]:
        """Draw the files of `to_draw` again, as described for `Editor.draw`; returns their names."""
        names = self.to_draw
        if not names:
            return []
        self.journal.open()
        states, stored = self._states, self.stored
        with states.lock:
            saves, calibrations = stored.saves, [stored.calibration(id) for id in states.frames.ids]
        clip = stored.clip()
        with stored.drawing() as drawn:
            draw_again(drawn, states.frames, calibrations, clip, states.field, names, progress)
            with states.lock:
                if stored.saves != saves:
                    return []
                self._go_on()
                stored.draw(drawn, self._new.options, self._announcing("written"))
                self._finish()
        return names

    def save_labels(self, format: str) -> str:
        """Write the labels by hand of all frames in a format; returns the name of the file or the folder."""
        self.journal.open()
        with self._states.lock:
            self._go_on()
            name, files = label_files(format, self._annotations(self._states))
            self.stored.write(files, self._announcing("written"))
            self._finish()
            self.last_save = LastSave(self.stored.replaced)
        return name

    def _label_file(self, number: int) -> dict[str, bytes | None]:
        """Content of SoccerNet's file with the labels of a frame, by its name; None to remove it."""
        name = label_file(self._id(number))
        annotations = self._annotations([number])
        return {name: soccernet_file(annotations[0]) if annotations else None}

    def _label_files(self, numbers: Sequence[int]) -> dict[str, bytes | None]:
        """Contents of the files in the format of the given labels, when some frames are saved."""
        if self._label_format is None or self._label_format == SOCCERNET:  # each frame has a file of SoccerNet's
            return {}
        return saved_files(self._label_format, self._annotations(self._states), [self._id(n) for n in numbers])

    def _annotations(self, numbers: Iterable[int]) -> list[Annotation]:
        """Labels by hand of frames, in the order of the frames."""
        frames, field = self._states.frames, self._states.field
        states = {n: self._states[n] for n in sorted(numbers)}
        edits = {n: state.edits.history.present for n, state in states.items() if state.is_anchor}
        return [
            Annotation(self._id(n), one.marks.ordered(field), frames.size(n), frames.name(n))
            for n, one in edits.items()
            if len(one.marks)
        ]

    def _begin(self, numbers: Iterable[int]) -> None:
        """Write given labels that are about to be saved to the journal as the first state of their frames."""
        if self._label_format is not None and not self._has_noted_format:
            self.journal.add(format=self._label_format)
            self._has_noted_format = True
        for n in numbers:
            state = self._states.get(n)
            if state is not None and not state.has_begun and state.is_anchor:
                self.journal.begin(self._id(n), state.edits.history.present, state.base)
                state.has_begun = True

    def _announcing(self, kind: str, numbers: Sequence[int] = (), done: Callable[[], None] = ignored) -> Announce:
        """Function that announces a save in the journal; `done` is called when its files are there, see `_finish`."""

        def announce(announced: Announced) -> None:
            states = {self._id(n): self._states[n] for n in numbers}
            note = self.journal.announce(announced, kind, [id for id, state in states.items() if state.has_begun])
            edits = {id: state.edits.history.present for id, state in states.items() if not state.is_untouched}
            self._unfinished = Unfinished(announced, note, edits, done)

        return announce

    def _finish(self) -> None:
        """Note in the journal that the announced files are in place, and update the states of their frames."""
        unfinished = self._unfinished
        assert unfinished is not None
        self.journal.add(**unfinished.note)
        self._unfinished = None
        is_taken_back = "taken_back" in unfinished.note
        self.stored.note_saved(None if is_taken_back else self.stored.versions.kept)
        for id, edit in unfinished.edits.items():
            edits = self._states[self._states.numbers[id]].edits
            if is_taken_back:
                edits.note_taken_back()
            else:
                edits.note_saved(edit)
        unfinished.done()

    def _go_on(self) -> None:
        """Finish a save that could not be finished before."""
        if self._unfinished is None:
            return
        if self.stored.versions.finish(self._unfinished.announced):
            self._finish()
        else:
            self.journal.add(**NOTHING_WRITTEN)
            self._unfinished = None
