"""The editor of pictures and clips: labels of a person, the cameras that follow, and a folder that keeps both."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from threading import RLock, Thread
from typing import Self
from warnings import warn

from fieldcalib._checks import expect, file_path, truth, whole_number
from fieldcalib.assess.findings import Status
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.draw.overlays import draw_calibration
from fieldcalib.editor.clip import FirstPass, Progress, Proposal, first_pass, solve, window_around
from fieldcalib.editor.drawings import AGAIN, draw_again
from fieldcalib.editor.edit import Edit, History, Marks, check_edit
from fieldcalib.editor.fitting import automatic, is_to_search, network_marks, network_of, searched
from fieldcalib.editor.frame import FrameEditor, moved_marks
from fieldcalib.editor.frame_states import BeforeKeep, FrameState, basis_of
from fieldcalib.editor.frame_table import Row, Table, next_frame
from fieldcalib.editor.journal import (
    JOURNAL,
    NOTHING_WRITTEN,
    FrameHistory,
    Journal,
    Replayed,
    Unfinished,
    nothing,
    read_journal,
)
from fieldcalib.editor.label_files import (
    SOCCERNET,
    GivenLabels,
    LabelWarning,
    given_labels,
    label_file,
    label_files,
    saved_files,
    soccernet_file,
)
from fieldcalib.editor.label_versions import Announce, Announced
from fieldcalib.editor.opening import field_of, frames_of, places_of
from fieldcalib.editor.saved_files import LastSave, NewRun, Saved, Spilled, Stored, is_by_hand
from fieldcalib.fields.field import Field
from fieldcalib.images.camera_side import CameraSide
from fieldcalib.io.annotations import Annotation
from fieldcalib.io.formats import OVERLAYS
from fieldcalib.io.image import Image
from fieldcalib.io.videos import DEFAULT_RATE
from fieldcalib.localize import Network
from fieldcalib.solve.request import NOTHING_GIVEN
from fieldcalib.solve.solver_options import ALL

AT_ONCE = 5000  # rows of the table, about, that are read before a page is shown


def ignored(done: int, count: int, stage: str) -> None:
    """Take no notice of the progress of some work."""


class StaleEdit(ValueError):
    """A change of a frame that somebody else has changed meanwhile."""


class Editor:
    """Pictures or a clip, the labels of a person, and the cameras that follow from them.

    Parameters
    ----------
    source : path, or list of (height, width, 3) uint8 arrays
        A picture, a folder of pictures, a video, or a folder of results, which says where its pictures are.
    field : Field or str, optional
        The field, its name, or the path of a file with one; by default that of the results, or soccer.
    out : path, optional
        The folder of results; by default the source if it is one, or ``<name>-fieldcalib`` beside it. It is made with
        the first change. Arrays have none unless it is given.
    labels : path, optional
        Annotations of SoccerNet, labelme, CVAT, Label Studio or COCO, a file, or a folder or a zip of files: what a
        person has said of the frames that are named so. Frames that were changed in the folder before keep what they
        have there. The files are never written to: labels are saved in their format into the folder.
    overwrite : bool
        Whether files in the folder may be replaced that neither a run nor a page has written.

    Raises
    ------
    FileNotFoundError, BrokenFileError
        If the source does not exist, or is neither pictures nor a video; and as
        `fieldcalib.editor.label_files.given_labels`.
    FileExistsError
        If saving would replace files that neither a run nor a page has written, or those of `labels`.
    ValueError
        If the field is unknown, results do not say where their pictures are, or no label is of a frame.
    """

    def __init__(
        self,
        source: str | os.PathLike[str] | Sequence[Image],
        field: Field | str | None = None,
        *,
        out: str | os.PathLike[str] | None = None,
        labels: str | os.PathLike[str] | None = None,
        overwrite: bool = False,
    ) -> None:
        paths, folder = places_of(source, out)
        self.stored = None if folder is None else Stored(folder, overwrite=truth(overwrite, "overwrite"))
        self.field, self.field_name = field_of(field, self.stored)
        check = partial(check_edit, field=self.field)
        replayed = Replayed(check) if folder is None else read_journal(folder / JOURNAL, check)
        self.title = "images" if paths is None else paths[0].name
        self.frames = frames_of(source, paths, self.stored)
        self.version = 0
        self.lock = RLock()
        """Held while frames are changed; reading is safe without."""
        self._states: dict[int, FrameState] = {}
        self._values = Spilled()
        self._rows = [Row()] * len(self.frames)
        self._numbers = {id: number for number, id in enumerate(self.frames.ids)}
        self._journal = None if folder is None else Journal(folder, replayed.size)
        self._new = NewRun({"field": self.field_name}, paths or (), self.frames.rate or DEFAULT_RATE)
        self.cuts = replayed.cuts or ([] if self.stored is None else self.stored.cuts)
        """First frames of the shots of a clip, as far as they are known."""
        self.has_own_cuts = replayed.cuts is not None
        """Whether a person has set the cuts."""
        self._first_pass: FirstPass | None = None
        self._before_keep: BeforeKeep | None = None
        self._unfinished: Unfinished | None = None
        self.last_save = LastSave()
        """What the last save has replaced, and which frames it has left out."""
        given = GivenLabels() if labels is None else given_labels(file_path(labels, "labels"), self.frames, self.field)
        if self.stored is not None:
            if self.stored.know(replayed.written):
                replayed.forget_saved()
            self.stored.check_in_the_way(self.ids, given.files)
        self.label_format = given.format or replayed.format
        """The format of the labels that were given, now or when the folder was opened before; None without any."""
        self._has_noted_format = self.label_format == replayed.format
        self._restore(replayed, given)

    def _restore(self, replayed: Replayed, given: GivenLabels) -> None:
        """Take what results, journal and given labels say."""
        self._unfinished = replayed.unfinished  # what was announced and could not be finished yet
        for said in replayed.remarks(self.field):
            warn(said, LabelWarning, stacklevel=4)
        for id, edits in replayed.frames.items():
            if id in self._numbers:
                number = self._numbers[id]
                self._states[number] = FrameState(edits, self._values, has_begun=True, base=self._base(id, edits))
                edits.base = None
                self._show_saved(number)
                self._rows[number] = self._rows[number]._replace(by_hand=not edits.history.present.automatic)
        for number, marks in given.marks.items():
            if number not in self._states:
                edits = FrameHistory(History(Edit(marks)))
                self._states[number] = FrameState(edits, self._values, base=self._base(self.ids[number], edits))
                self._rows[number] = self._rows[number]._replace(by_hand=True)
        if self.stored is None or len(self.stored.ids) <= AT_ONCE:
            self._fill_rows()
        else:  # an hour of video opens at once, its table grows
            Thread(target=self._fill_rows, name="rows", daemon=True).start()

    def _show_saved(self, number: int) -> None:
        """Show the camera of a clip's frame that was saved: it may be that of the clip, not that of its marks alone."""
        state, id = self._states[number], self.ids[number]
        if self.is_clip and self.stored is not None and state.is_saved and is_by_hand(self.stored.basis(id)):
            saved = self._stored_calibration(id)
            if saved is not None:
                state.keep(saved)

    def _fill_rows(self) -> None:
        """Take what the results say into the table; a clip that is solved again replaces the cameras of all frames."""
        for count, (id, row) in enumerate(() if self.stored is None else self.stored.rows(), 1):
            number = self._numbers.get(id)
            if number is not None and not self._rows[number].verdict:
                self._rows[number] = row._replace(by_hand=self._rows[number].by_hand)
            self.version += count % AT_ONCE == 0
        self.version += 1

    def _base(self, id: str, edits: FrameHistory) -> Calibration | None:
        """The camera of a frame without a person: that of the results, unless it is one of a person."""
        if self.stored is not None and id in self.stored and not is_by_hand(self.stored.basis(id)):
            return self._stored_calibration(id)
        try:
            return None if edits.base is None else self._of_field(Calibration.from_dict(edits.base))
        except ValueError:  # of another version, say: it is found again
            return None

    def _stored_calibration(self, id: str) -> Calibration | None:
        """The calibration of a frame in the results; None if there is none of this field."""
        return None if self.stored is None else self._of_field(self.stored.calibration(id))

    def _of_field(self, calibration: Calibration | None) -> Calibration | None:
        """The calibration; None if it is of another field than the one that is opened, not only of another size."""
        if calibration is None or calibration.field is None or calibration.field.keys() == self.field.keys():
            return calibration
        return None

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def ids(self) -> Sequence[str]:
        """Names of the frames."""
        return self.frames.ids

    @property
    def is_clip(self) -> bool:
        """Whether the frames are those of a video."""
        return self.frames.rate is not None

    @property
    def network(self) -> Network | None:
        """The network that knows the markings of the field, as seen from the side that the run was told.

        None if there is none.
        """
        network = network_of(self.field)
        return None if network is None else self._side.network(network, self.field)

    @cached_property
    def _side(self) -> CameraSide:
        """The side of the field that the run of the folder was told."""
        record = None if self.stored is None else self.stored.record
        options = {} if record is None else record.options
        prior = options.get("prior") if options.get("prior") in self.field.named_stands else ALL
        return CameraSide.of(self.field, NOTHING_GIVEN, 0, prior, options.get("side"))

    @property
    def table(self) -> Table:
        """A row for each frame."""
        return Table(self.ids, self._rows)

    @property
    def unsaved(self) -> int:
        """Number of frames whose present state is not in the files of the folder."""
        return sum(not state.is_saved for state in list(self._states.values()))

    def claim(self) -> str:
        """Keep other programs from writing to the folder before the first change; returns in words why that fails.

        A folder to which another page or run writes is shown, and its frames can be changed when that has ended.
        """
        with self.lock:
            return "" if self._journal is None else self._journal.claim()

    def revision(self, number: int) -> int:
        """How often a frame was changed."""
        state = self._states.get(self.frames.number(number))
        return 0 if state is None else state.revision

    def __getitem__(self, number: int) -> FrameEditor:
        """A frame as it is now; its camera is found by itself where nobody has labelled anything yet.

        Raises
        ------
        BrokenFileError
            If its image cannot be read.
        IndexError
            If there is no such frame.
        """
        image = self.frames.image(number)
        state = self._state(number, image)
        base = state.base
        field = self.field if base is None or base.field is None else base.field
        return FrameEditor(image, field, state.edits.history, base, state.found)

    def _state(self, number: int, image: Image) -> FrameState:
        """The state of a frame, which begins with the camera that is stored, or found by itself."""
        state = self._states.get(number)
        if state is None:
            stored = self._stored_calibration(self.ids[number])
            edit = Edit(automatic=True)
            if stored is None:
                stored, marks = automatic(self.field, image, self.network)
                edit = Edit(marks, automatic=True)
            with self.lock:
                new = FrameState(edit, self._values, base=stored)
                state = self._states.setdefault(number, new)
                self._set_row(number, Row.of(stored, self._rows[number].basis))
        elif state.base is None:
            state.base, _ = automatic(self.field, image, self.network)
        return state

    def with_camera(self, number: int) -> FrameEditor:
        """A frame with the camera that follows from its marks, which is kept until the frame changes."""
        revision = self.revision(number)
        one = self[number]
        found = one.calibration
        with self.lock:
            state = self._states[number]
            if state.revision == revision and not one.is_automatic and state.found is None:
                state.found = found
        return one

    def fitted(self, number: int) -> FrameEditor:
        """A frame `with_camera`, whose verdict is then in the table."""
        revision = self.revision(number)
        one = self.with_camera(number)
        row = Row.of(one.calibration, self._basis(number, one), by_hand=not one.is_automatic)
        with self.lock:
            if self.revision(number) == revision:
                self._set_row(number, row)
        return one

    def _basis(self, number: int, one: FrameEditor) -> str:
        if not one.is_automatic:
            return basis_of(one.marks)
        basis = "" if self.stored is None else self.stored.basis(self.ids[number])
        return "" if is_by_hand(basis) else basis  # a person has taken back all that was said

    def _set_row(self, number: int, row: Row) -> None:
        if self._rows[number] != row:
            self._rows[number] = row
            self.version += 1

    def is_to_search(self, number: int) -> bool:
        """Whether the court is still to be searched for in a frame that was looked at, see `search`."""
        state = self._states.get(self.frames.number(number))
        return state is not None and state.base is not None and is_to_search(state.base)

    def search(self, number: int) -> bool:
        """Search a frame for the court, where no network knows the field; returns whether it was to be searched.

        The camera that is found is that of the frame until a person changes something: half a second and more, for
        which nothing else waits. Fields without stands are not searched for.
        """
        one = self[number]
        if not self.is_to_search(number):
            return False
        try:
            found = searched(self.field, one.image)
        except ValueError as error:
            found = Calibration.without_camera(Status.TOO_FEW_SEGMENTS, f"the court cannot be searched for: {error}")
        with self.lock:
            state = self._states[number]
            state.base = found
            if not state.is_anchor:
                self._set_row(number, Row.of(found))
                if self.stored is not None and self.ids[number] in self.stored:  # without a camera
                    state.touched().saved = None
            self.version += 1
        return True

    def gets_marks(self, number: int) -> bool:
        """Whether marks of the network join those of a person with the first change of a frame, see `begun`."""
        one = self[number]
        return self.revision(number) == 0 and one.is_automatic and not len(one.marks) and self.network is not None

    def begun(self, number: int) -> FrameEditor:
        """A frame that is about to be changed: with the labels of the network, if it has no marks yet.

        While some of them are left, the basis of the frame is "labelled by hand and by the network".
        """
        one = self[number]
        network = self.network
        if network is not None and self.gets_marks(number):
            marks = network_marks(one.field, one.image, network)
            with self.lock:
                state = self._states[number]
                if state.revision == 0:
                    edits, was_saved = state.touched(), state.is_saved
                    edits.history = History(Edit(marks, automatic=True))
                    if was_saved:
                        edits.note_saved()
            return self[number]
        return one

    def automatic(self, number: int) -> FrameEditor:
        """A frame with the camera that was found without a person, and with the labels of the network again."""
        one, network = self[number], self.network
        return one.automatic(Marks() if network is None else network_marks(one.field, one.image, network))

    def with_marks_of(self, number: int, other: int) -> FrameEditor:
        """A frame with the marks of another one, moved as the background moves and snapped to paint.

        Raises
        ------
        ValueError
            If the other frame has no marks, or shows no background that this one shows too.
        """
        one, source = self[number], self[other]
        if not len(source.marks):
            raise ValueError(f"frame {self.ids[other]} has no marks to copy: label it first")
        return one.with_marks(moved_marks(source.marks, source.image, one))

    def put(self, number: int, changed: FrameEditor, revision: int | None = None) -> None:
        """Change a frame: keep its new state, in the journal first.

        Parameters
        ----------
        number : int
        changed : FrameEditor
            As one of the methods of ``editor[number]`` gives it.
        revision : int, optional
            The revision that was changed; by default the present one.

        Raises
        ------
        ValueError
            If it cannot be, as an impossible size of the field; then nothing is changed.
        StaleEdit
            If the frame was changed since that revision.
        OSError
            If the journal cannot be written; then nothing is changed.
        """
        expect(changed, FrameEditor, "editor[0].mark(...)")
        with self.lock:
            state = self._states.get(self.frames.number(number))
            if state is None:
                state = self._state(number, self.frames.image(number))
            if revision is not None and whole_number(revision, "revision") != state.revision:
                raise StaleEdit(
                    f"frame {self.ids[number]} was changed meanwhile: it has revision {state.revision}, the "
                    f"change is of revision {revision}; load it again"
                )
            before, after = state.edits.history, changed.history
            if after == before:
                return
            check_edit(after.present, self.field)
            if self._journal is not None:
                if not state.has_begun:
                    self._journal.begin(self.ids[number], before.present, state.base)
                    state.has_begun = True
                if state.touched().left_out:
                    self._journal.left_out(self.ids[number])
                    state.touched().left_out = 0
                self._journal.change(self.ids[number], before, after)
            state.change(before.changed_to(after), changed.found)

    def __setitem__(self, number: int, changed: FrameEditor) -> None:
        """Change a frame, see `put`."""
        self.put(number, changed)

    def set_cuts(self, cuts: Sequence[int]) -> None:
        """Say which frames are the first ones of the shots of a clip; the first frame of all is one in any case.

        Raises
        ------
        ValueError
            If it is no clip, or they are not numbers of its frames.
        """
        if not self.is_clip:
            raise ValueError("expected a clip: pictures have no cuts")
        if not all(0 <= cut < len(self) for cut in cuts):
            raise ValueError(f"expected numbers of frames from 0 to {len(self) - 1} as cuts")
        with self.lock:
            self.cuts = sorted({0, *cuts})
            self.has_own_cuts = True
            if self._journal is not None:
                self._journal.cuts(self.cuts)

    def solve(self, progress: Progress = ignored) -> Proposal:
        """Solve a clip again around the frames that a person has mended; nothing is changed until `keep`.

        Parameters
        ----------
        progress : callable
            Gets the number of frames that are done, of all, and the stage; may raise an error to end the work.

        Raises
        ------
        ValueError
            If it is no clip, or its field is neither known to the network nor to be searched for, as it has no stands.
        """
        network = self.network
        if not self.is_clip:
            raise ValueError("expected a clip: pictures are mended one by one")
        if network is None and not self.field.stands:
            raise ValueError(
                "expected a field that the network knows, or one with stands, for which courts can be searched: say in "
                "the file of the field where its cameras stand"
            )
        revisions = {n: self.revision(n) for n, state in sorted(self._states.items()) if state.is_anchor}
        anchors = {n: self._by_marks(n) for n in revisions}
        window = window_around(len(self), [*anchors])
        if self._first_pass is None or self._first_pass.window != window:
            record = None if self.stored is None else self.stored.record
            options = {} if record is None else record.options
            self._first_pass = first_pass(self.frames, window, self.field, network, options, progress)
        cuts = self.cuts if self.has_own_cuts else None
        found = solve(self.frames, self._first_pass, anchors, cuts, self._now, network, progress)
        return replace(found, revisions={n: revisions[n] for n in found.anchors})

    def next_to_mend(self) -> int | None:
        """The frame of a clip whose labels would help most; None if all cameras are good.

        Raises
        ------
        ValueError
            If it is no clip.
        """
        if not self.is_clip:
            raise ValueError("expected a clip: pictures are mended one by one")
        return next_frame(self.frames, self._rows, self.field, self.network)

    def _by_marks(self, number: int) -> Calibration:
        """The camera of a frame that follows from its marks alone, also where that of the clip was kept."""
        one, state = self[number], self._states[number]
        return replace(one, found=None).calibration if state.is_of_clip else self.fitted(number).calibration

    def _now(self, number: int) -> Calibration | None:
        """The calibration that a frame has now."""
        state = self._states.get(number)
        if state is None:
            return self._stored_calibration(self.ids[number])
        return state.found if state.is_anchor else state.base

    def keep(self, proposal: Proposal) -> int:
        """Take the cameras of a solution, and write them into the folder, as `save` does; returns their number.

        The labels of its anchors are written too. Outside the window that was solved everything stays as it was.

        Raises
        ------
        ValueError, ChangedFileError, OSError
            As `save`.
        """
        stored, _ = self._opened_folder()
        with self.lock:
            self._go_on()
            frames = []
            for n, calibration in proposal.calibrations.items():
                is_anchor = n in proposal.anchors
                files = self._label_file(n) if is_anchor else {}
                basis = basis_of(self._states[n].edits.history.present.marks) if is_anchor else proposal.basis(n)
                frames.append(Saved(self.ids[n], calibration, basis, files))
            more = self._label_files(sorted(proposal.anchors))
            states = {n: one.copy() for n, one in self._states.items()}
            rows, cuts = list(self._rows), list(self.cuts)
            saved = [n for n, revision in proposal.revisions.items() if self.revision(n) == revision]
            self._begin(saved)

            def done() -> None:
                self._before_keep = BeforeKeep(proposal, states, rows, cuts, stored.saves, saved)
                for n, calibration in proposal.calibrations.items():
                    self._take(n, calibration, proposal)
                if not self.has_own_cuts:
                    begin, end = proposal.window
                    inside = (begin + shot.start for shot in proposal.video.shots)
                    self.cuts = sorted({*inside, *(cut for cut in self.cuts if not begin <= cut < end)})
                self.version += 1

            announce = self._announcing("saved", saved, done)
            stored.save(frames, self.ids, self._new, announce, clip=self._whole(proposal), more=more)
            self._finish()
        return len(frames)

    @property
    def can_undo_keep(self) -> bool:
        """Whether the last save was that of a solution of the clip, which can be taken back."""
        before = self._before_keep
        return before is not None and self.stored is not None and self.stored.saves == before.saves

    def undo_keep(self) -> Proposal:
        """Take the solution back that was kept last: files and cameras are as they were; returns the solution.

        What a person has changed since stays. The files of the solution are kept in ``history``.

        Raises
        ------
        ValueError
            If none was kept, or something was saved since.
        ChangedFileError, OSError
            As `save`.
        """
        before = self._before_keep
        if before is None or not self.can_undo_keep:
            raise ValueError("expected a solution that was kept last: since then something else was saved, or nothing")
        stored, _ = self._opened_folder()
        with self.lock:
            self._go_on()
            if self._before_keep is not None:  # it was not taken back before, up to the note of it
                stored.take_back(self._announcing("taken_back", before.saved, partial(self._forget_keep, before)))
                self._finish()
        return before.proposal

    def _forget_keep(self, before: BeforeKeep) -> None:
        """Go back to what was known before a solution was kept, but for what a person has changed since."""
        self._before_keep = None
        for n, state in list(self._states.items()):
            if n in before.states:
                state.before(before.states[n])
            else:
                state.base = self._base(self.ids[n], state.edits)
                state.found = None
        changed = {n for n, state in self._states.items() if self._is_changed_since(n, before.states)}
        self._rows = [self._rows[n] if n in changed else row for n, row in enumerate(before.rows)]
        if not self.has_own_cuts:
            self.cuts = list(before.cuts)
        self.version += 1

    def _is_changed_since(self, number: int, states: Mapping[int, FrameState]) -> bool:
        before = states.get(number)
        return self.revision(number) != (0 if before is None else before.revision)

    def _whole(self, proposal: Proposal) -> VideoCalibration | None:
        """The calibration of all frames of the clip with a solution; None if there is none."""
        stored, (begin, end) = self.stored, proposal.window
        assert stored is not None
        if end - begin == len(self):
            return proposal.whole(None, len(self))
        outside = [id for n, id in enumerate(self.ids) if not begin <= n < end]
        mended = any(is_by_hand(stored.basis(id)) for id in outside)
        return proposal.whole(stored.clip(), len(self), mended_outside=mended)

    def _take(self, number: int, calibration: Calibration, proposal: Proposal) -> None:
        """Take the camera of a frame in a solution; not where the frame was changed since."""
        state = self._states.get(number)
        if state is None or not state.is_anchor:
            if state is not None:
                state.base = calibration
            self._set_row(number, Row.of(calibration, proposal.basis(number)))
        elif proposal.revisions.get(number) == state.revision:
            state.keep(calibration)
            self._set_row(number, Row.of(calibration, self._rows[number].basis, by_hand=True))

    def save(self) -> int:
        """Write labels and cameras into the folder, as ``fieldcalib run`` writes them; returns the number of frames.

        Frames that were changed are written, and those that have no result there yet but were looked at, unless
        `search` is still to come. Labels by hand go to ``labels/<id>.json``, and into files of the format of those
        that were given. What is replaced is kept in ``history``: `last_save` says where, and which frames could not be
        saved.

        Raises
        ------
        ValueError
            If there is no folder.
        ChangedFileError
            If a file would be replaced that neither a run nor a page has written, or that another program has changed;
            then nothing is written.
        UnfinishedSaveError
            If the files were written, and not all could be moved to their places: the next save goes on.
        OSError
            If a file cannot be written; then nothing is changed.
        """
        stored, _ = self._opened_folder()
        with self.lock:
            self._go_on()
            numbers = [n for n, state in sorted(self._states.items()) if self._is_to_save(n, state)]
            saved: list[int] = []
            failed: dict[str, str] = {}
            more = self._label_files(numbers)
            cuts = self.cuts if self.has_own_cuts else None
            announce = self._announcing("saved", saved)
            stored.save(self._each_saved(numbers, saved, failed), self.ids, self._new, announce, more=more, cuts=cuts)
            self._finish()
            self.last_save = LastSave(stored.replaced, failed)
        return len(saved)

    def _each_saved(self, numbers: Sequence[int], saved: list[int], failed: dict[str, str]) -> Iterator[Saved]:
        """Frames to be saved; `saved` gets the numbers of those that can be, `failed` the others, with the reasons."""
        for n in numbers:
            try:
                one = self._saved(n)
            except (ValueError, ArithmeticError) as error:
                failed[self.ids[n]] = str(error)
                continue
            self._begin([n])
            saved.append(n)
            yield one

    def _opened_folder(self) -> tuple[Stored, Journal]:
        """The folder of results and its journal, which no other program may write to from here on."""
        if self.stored is None or self._journal is None:
            raise ValueError("expected a folder to save to: give Editor(..., out=...)")
        self._journal.open()
        return self.stored, self._journal

    def _announcing(self, kind: str, numbers: Sequence[int] = (), done: Callable[[], None] = nothing) -> Announce:
        """Announce a save of some frames in the journal; `done` is called when its files are there, see `_finish`."""

        def announce(announced: Announced) -> None:
            assert self._journal is not None
            states = {self.ids[n]: self._states[n] for n in numbers}
            note = self._journal.announce(announced, kind, [id for id, state in states.items() if state.has_begun])
            edits = {id: state.edits.history.present for id, state in states.items() if not state.is_untouched}
            self._unfinished = Unfinished(announced, note, edits, done)

        return announce

    def _finish(self) -> None:
        """Note that the files are there that were announced."""
        stored, journal, unfinished = self.stored, self._journal, self._unfinished
        assert stored is not None
        assert journal is not None
        assert unfinished is not None
        journal.done(unfinished.note)
        self._unfinished = None
        is_taken_back = "taken_back" in unfinished.note
        stored.note_saved(None if is_taken_back else stored.versions.kept)
        for id, edit in unfinished.edits.items():
            edits = self._states[self._numbers[id]].edits
            if is_taken_back:
                edits.note_taken_back()
            else:
                edits.note_saved(edit)
        unfinished.done()

    def _go_on(self) -> None:
        """Finish a save that could not be finished before."""
        stored, unfinished = self.stored, self._unfinished
        if unfinished is None or stored is None or self._journal is None:
            return
        if stored.versions.finish(unfinished.announced):
            self._finish()
        else:
            self._journal.done(NOTHING_WRITTEN)
            self._unfinished = None

    @property
    def to_draw(self) -> list[str]:
        """Files of a clip that show older cameras, were moved to the history, and can be drawn again."""
        if self.stored is None or not self.is_clip:
            return []
        return [name for name in self.stored.moved if name in AGAIN]

    def draw(self, progress: Progress = ignored) -> list[str]:
        """Draw the files of `to_draw` again from what is saved; returns their names.

        If cameras are saved meanwhile, the drawings are old again, and none is kept.

        Parameters
        ----------
        progress : callable
            As in `solve`.

        Raises
        ------
        OSError
            If a file cannot be written.
        """
        names = self.to_draw
        if not names:
            return []
        stored, _ = self._opened_folder()
        with self.lock:
            saves, calibrations = stored.saves, [stored.calibration(id) for id in self.ids]
        clip = stored.clip()
        with stored.drawing() as folder:
            draw_again(folder, self.frames, calibrations, clip, self.field, names, progress)
            with self.lock:
                if stored.saves != saves:
                    return []
                self._go_on()
                stored.draw(folder, self._new.options, self._announcing("written"))
                self._finish()
        return names

    def _label_files(self, numbers: Sequence[int]) -> dict[str, bytes | None]:
        """Files in the format of the labels that were given, when some frames are saved."""
        if self.label_format is None or self.label_format == SOCCERNET:  # each frame has a file of SoccerNet's
            return {}
        return saved_files(self.label_format, self._annotations(self._states), [self.ids[n] for n in numbers])

    def _begin(self, numbers: Iterable[int]) -> None:
        """Let given labels that are about to be saved begin in the journal."""
        assert self._journal is not None
        if self.label_format is not None and not self._has_noted_format:
            self._journal.format(self.label_format)
            self._has_noted_format = True
        for n in numbers:
            state = self._states.get(n)
            if state is not None and not state.has_begun and state.is_anchor:
                self._journal.begin(self.ids[n], state.edits.history.present, state.base)
                state.has_begun = True

    def _is_to_save(self, number: int, state: FrameState) -> bool:
        if not state.is_saved:
            return True
        is_new = self.stored is not None and self.ids[number] not in self.stored
        return is_new and (state.is_anchor or not self.is_to_search(number))

    def _saved(self, number: int) -> Saved:
        """A frame with the contents of its files."""
        one, id = self.fitted(number), self.ids[number]
        calibration = one.calibration
        files = self._label_file(number)
        if not self.is_clip:
            drawn = draw_calibration(one.image, calibration, calibration.field or one.field)
            files[OVERLAYS.file_name(id)] = OVERLAYS.write(drawn)
        return Saved(id, calibration, self._rows[number].basis, files)

    def _label_file(self, number: int) -> dict[str, bytes | None]:
        """SoccerNet's file with the labels of a frame, by its name; None removes it."""
        name = label_file(self.ids[number])
        annotations = self._annotations([number])
        return {name: soccernet_file(annotations[0]) if annotations else None}

    def save_labels(self, format: str) -> str:
        """Write the labels by hand of all frames into the folder; returns the name of the file or the folder.

        Parameters
        ----------
        format : {"soccernet", "labelme", "cvat", "coco", "labelstudio"}

        Raises
        ------
        ValueError
            If there is no folder, no label, or no such format.
        ChangedFileError, OSError
            As `save`.
        """
        stored, _ = self._opened_folder()
        with self.lock:
            self._go_on()
            name, files = label_files(format, self._annotations(self._states))
            stored.write(files, self._announcing("written"))
            self._finish()
            self.last_save = LastSave(stored.replaced)
        return name

    def _annotations(self, numbers: Iterable[int]) -> list[Annotation]:
        """The labels by hand of frames, in their order."""
        states = {n: self._states[n] for n in sorted(numbers)}
        edits = {n: state.edits.history.present for n, state in states.items() if state.is_anchor}
        return [
            Annotation(self.ids[n], one.marks.ordered(self.field), self.frames.size(n), self.frames.name(n))
            for n, one in edits.items()
            if len(one.marks)
        ]

    def _repr_html_(self) -> str:
        """The first frame, for notebooks."""
        return self[0]._repr_html_()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the files; what was changed is in the journal."""
        self.frames.close()
        if self._journal is not None:
            self._journal.close()
