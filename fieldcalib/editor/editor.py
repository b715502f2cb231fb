"""The editor of pictures and clips: labels of a person, the cameras from them, and a folder in which both are saved."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any, Self
from warnings import warn

from fieldcalib._progress import counted
from fieldcalib._types import expect, file_path, one_of, truth, whole_number
from fieldcalib.assess.findings import Status
from fieldcalib.assess.result import Calibration
from fieldcalib.editor.clip import FirstPass, Progress, Proposal, first_pass, next_frame, solve, window_around
from fieldcalib.editor.edit import Edit, History, Marks, check_edit
from fieldcalib.editor.fitting import automatic, marks_of, network_marks, network_of, searched, with_strays
from fieldcalib.editor.folder import NOTHING_KEPT, Folder, field_of, frames_of, places_of
from fieldcalib.editor.frame import FrameEditor, moved_marks
from fieldcalib.editor.frame_states import FrameState, FrameStates, Row, Table, basis_of, is_by_hand
from fieldcalib.editor.journal import JOURNAL, FrameHistory, Replayed, chosen_field, read_journal
from fieldcalib.editor.label_files import GivenLabels, LabelWarning, given_labels
from fieldcalib.editor.saved_files import LastSave, NewRun, Stored
from fieldcalib.fields.catalogue import FIELDS
from fieldcalib.fields.field import Field
from fieldcalib.images.camera_side import CameraSide
from fieldcalib.io.decoders import DEFAULT_RATE
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.frame_source import ignored
from fieldcalib.io.image_files import Image
from fieldcalib.localize import Network
from fieldcalib.results.frames import NoFrameError
from fieldcalib.solve.request import Task
from fieldcalib.solve.solver_options import ALL


class StaleEdit(ValueError):
    """Raised for a change of a frame that somebody else has changed meanwhile."""


class Editor:
    """Pictures or a clip, the labels of a person, and the cameras calibrated from them.

    Parameters
    ----------
    source : path, or list of (height, width, 3) uint8 arrays
        A picture, a folder of pictures, a video, or a folder of results, which says where its pictures are.
    field : Field or str, optional
        The field, its name, or the path of a file with one; by default that which was chosen on the page, that of the
        results, or soccer.
    out : path, optional
        The folder of results; by default the source if it is one, or ``<name>-fieldcalib`` beside it. It is made with
        the first change. Arrays have none unless it is given.
    labels : path, optional
        Annotations of SoccerNet, labelme, CVAT, Label Studio or COCO: a file, or a folder or a zip of files. They are
        taken as labels by hand of the frames with the same names. Frames that were changed in the folder before keep
        their labels from there. The annotation files are never written to: labels are saved in their format into the
        folder.
    overwrite : bool
        Whether files in the folder may be replaced that were written neither by a run nor from the page.

    Raises
    ------
    FileNotFoundError, BrokenFileError
        If the source does not exist, or is neither pictures nor a video; and as
        `fieldcalib.editor.label_files.given_labels`.
    FileExistsError
        If saving would replace files that were written neither by a run nor from the page, or the files of `labels`.
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
        stored = None if folder is None else Stored(folder, overwrite=truth(overwrite, "overwrite"))
        chosen = None if folder is None or field is not None else chosen_field(folder / JOURNAL)
        self.field, self.field_name = field_of(chosen if field is None else field, stored)
        self._source, self._overwrite = source, overwrite
        check = partial(check_edit, field=self.field)
        replayed = Replayed(check) if folder is None else read_journal(folder / JOURNAL, check)
        self.title = "images" if paths is None else paths[0].name
        self.frames = frames_of(source, paths, stored)
        cuts = replayed.cuts or ([] if stored is None else stored.cuts)
        self._states = FrameStates(self.frames, self.field, cuts, has_own_cuts=replayed.cuts is not None)
        self.lock = self._states.lock
        """Held while frames are changed; reading is safe without."""
        self._first_pass: FirstPass | None = None
        given = GivenLabels() if labels is None else given_labels(file_path(labels, "labels"), self.frames, self.field)
        self.label_format = given.format or replayed.format
        """The format of the labels that were given, now or when the folder was opened before; None without any."""
        new = NewRun({"field": self.field_name}, paths or (), self.frames.rate or DEFAULT_RATE)
        self._folder = None if stored is None else Folder(stored, replayed, self._states, given, new)
        self._restore(replayed, given)

    def _restore(self, replayed: Replayed, given: GivenLabels) -> None:
        """Set the state of all frames from earlier results, the journal and given labels.

        The journal takes precedence over the results; given labels apply only to frames without edits in the journal.
        """
        for said in replayed.remarks(self.field):
            warn(said, LabelWarning, stacklevel=3)
        if self._folder is not None:
            self._folder.restore(replayed.frames)
        for number, marks in given.marks.items():
            if number not in self._states:
                edits = FrameHistory(History(Edit(marks)))
                base = None if self._folder is None else self._folder.base(number, edits)
                self._states[number] = FrameState(edits, self._states.spilled, base=base)
                self._states.rows[number] = self._states.rows[number]._replace(by_hand=True)
        if self._folder is None:
            self._states.version += 1
        else:
            self._folder.show_rows()

    def _stored_calibration(self, number: int) -> Calibration | None:
        """The calibration of a frame in the results; None if there is none of this field."""
        return None if self._folder is None else self._folder.calibration(number)

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def ids(self) -> Sequence[str]:
        """Names of the frames."""
        return self.frames.ids

    @property
    def is_clip(self) -> bool:
        """Whether the frames are those of a video."""
        return self._states.is_clip

    @property
    def stored(self) -> Stored | None:
        """Results in the folder; None if there is no folder."""
        return None if self._folder is None else self._folder.stored

    @property
    def last_save(self) -> LastSave:
        """Report of the last save: the files that it replaced, and the frames that it left out."""
        return LastSave() if self._folder is None else self._folder.last_save

    @property
    def version(self) -> int:
        """How often the table or the cuts have changed."""
        return self._states.version

    @property
    def cuts(self) -> list[int]:
        """First frames of the shots of a clip, as far as they are known."""
        return self._states.cuts

    @property
    def has_own_cuts(self) -> bool:
        """Whether a person has set the cuts."""
        return self._states.has_own_cuts

    @property
    def network(self) -> Network | None:
        """The network that knows the markings of the field, with the names as seen from the run's side of the field.

        None if there is none.
        """
        network = network_of(self.field)
        return None if network is None else self._side.network(network, self.field)

    @cached_property
    def _side(self) -> CameraSide:
        """Side of the field that was given to the run of the folder."""
        options = self._run_options
        prior = options.get("prior") if options.get("prior") in self.field.named_stands else ALL
        return CameraSide.of(Task(self.field, prior=prior), options.get("side"))

    @property
    def _run_options(self) -> Mapping[str, Any]:
        """Options of the run that wrote the results of the folder."""
        record = None if self.stored is None else self.stored.record
        return {} if record is None else record.options

    @property
    def table(self) -> Table:
        """Table with a row for each frame."""
        return Table(self.ids, self._states.rows)

    @property
    def unsaved(self) -> int:
        """Number of frames whose present state is not saved in the files of the folder."""
        return sum(not state.is_saved for state in list(self._states.values()))

    def claim(self) -> str:
        """Lock the folder against other programs before the first change; returns why that failed, or "".

        A folder to which another page or run writes can be viewed; its frames can be changed once that has ended.
        """
        with self.lock:
            return "" if self._folder is None else self._folder.journal.claim()

    def on_field(self, name: str) -> Editor:
        """Close this editor, and open its source and folder on the field of another sport.

        The folder remembers the field. Labels belong to the markings of one field, so no frame may have any by hand.

        Raises
        ------
        ValueError
            If there is no such field, frames are labelled, or another program writes to the folder.
        OSError
            If the source cannot be read any more, or the journal cannot be written: this editor stays open.
        """
        one_of(name, FIELDS, "the sport")
        opened = {number: state.is_anchor for number, state in self._states.items()}
        if labelled := sum(opened.get(number, row.by_hand) for number, row in enumerate(self._states.rows)):
            raise ValueError(
                f"{counted(labelled, 'frame')} labelled by hand on the field of {self.field_name}: remove these labels "
                f"first, or choose another folder of results (--out)"
            )
        if refused := self.claim():
            raise ValueError(refused)
        out = None if self.stored is None else self.stored.folder
        self._remember_field(name)
        try:
            other = Editor(self._source, name, out=out, overwrite=self._overwrite)
        except Exception:  # its source is gone: this one stays
            self._remember_field(self.field_name)
            raise
        self.close()
        return other

    def _remember_field(self, name: str) -> None:
        if self._folder is not None:
            self._folder.journal.add(field=name)

    def revision(self, number: int) -> int:
        """How often a frame was changed."""
        return self._states.revision(self.frames.number(number))

    def __getitem__(self, frame: int | str) -> FrameEditor:
        """Return a frame, by number or id, in its present state.

        The camera of a frame that nobody has changed is found automatically, and the frame has labels that were found
        in it, to which a change adds (`begun`). A court without a network has a camera once `search` was called.

        Raises
        ------
        BrokenFileError
            If its image cannot be read.
        IndexError, KeyError
            If there is no such frame.
        """
        return self.begun(self._number(frame))

    def _number(self, frame: int | str) -> int:
        if not isinstance(frame, str):
            return self.frames.number(frame)
        if frame not in self._states.numbers:
            raise NoFrameError(frame, self._states.numbers)
        return self._states.numbers[frame]

    def _frame(self, number: int) -> FrameEditor:
        """Return a frame in its present state, without the labels of `begun`."""
        number = self.frames.number(number)
        try:
            image = self.frames.image(number)
        except BrokenFileError as error:
            with self.lock:
                self._states.show(number, Row(reason=str(error), concern=1.0))
            raise
        state = self._state(number, image)
        base = state.base
        field = self.field if base is None or base.field is None else base.field
        return FrameEditor(image, field, state.edits.history, base, state.found)

    def _state(self, number: int, image: Image) -> FrameState:
        """State of a frame; a new one begins with the camera that is stored, or found automatically."""
        state = self._states.get(number)
        if state is None:
            stored = self._stored_calibration(number)
            edit = Edit(automatic=True)
            if stored is None:
                stored, marks = automatic(self.field, image, self.network)
                edit = Edit(marks, automatic=True)
            with self.lock:
                new = FrameState(edit, self._states.spilled, base=stored)
                state = self._states.setdefault(number, new)
                self._states.show(number, Row.of(stored, self._states.rows[number].basis))
        elif state.base is None:
            state.base, _ = automatic(self.field, image, self.network)
        return state

    def with_camera(self, number: int) -> FrameEditor:
        """Return a frame with the camera calibrated from its marks, which is cached until the frame changes."""
        revision = self.revision(number)
        one = self._frame(number)
        found = one.calibration
        with self.lock:
            state = self._states[number]
            if state.revision == revision and not one.is_automatic and state.found is None:
                state.found = found
        return one

    def fitted(self, number: int) -> FrameEditor:
        """Return a frame `with_camera`, and show its verdict in the table."""
        revision = self.revision(number)
        one = self.with_camera(number)
        row = Row.of(one.calibration, self._basis(number, one), by_hand=not one.is_automatic)
        with self.lock:
            if self.revision(number) == revision:
                self._states.show(number, row)
        return one

    def _basis(self, number: int, one: FrameEditor) -> str:
        if not one.is_automatic:
            return basis_of(one.marks)
        basis = "" if self.stored is None else self.stored.basis(self.ids[number])
        return "" if is_by_hand(basis) else basis  # if stored as by hand, the person has undone all edits since

    def is_to_search(self, number: int) -> bool:
        """Whether a frame that was opened still has to be searched for the court, see `search`."""
        state = self._states.get(self.frames.number(number))
        return state is not None and state.is_to_search

    def search(self, number: int) -> bool:
        """Search a frame for the court, if no network knows the field; returns whether it had to be searched.

        The frame has the camera found until a person changes something. The search takes half a second or more, during
        which nothing else waits. Fields without stands are not searched for.
        """
        one = self._frame(number)
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
                self._states.show(number, Row.of(found))
                if self.stored is not None and self.ids[number] in self.stored:  # without a camera
                    state.touched().saved = None
            self._states.version += 1
        return True

    def gets_marks(self, number: int) -> bool:
        """Whether the first change of a frame will add marks that were found in it to the person's, see `begun`."""
        one = self._frame(number)
        is_new = self.revision(number) == 0 and one.is_automatic and not len(one.marks)
        return is_new and (self.network is not None or len(marks_of(one.base)) > 0)

    def begun(self, number: int) -> FrameEditor:
        """Return a frame that is about to be changed, with labels that were found in it if it has no marks yet.

        They are the network's or, on a field that it does not know, those that the camera was fitted to. While any of
        them are left, the basis of the frame is "labelled by hand and by the network".
        """
        one = self._frame(number)
        network = self.network
        if self.gets_marks(number):
            marks = marks_of(one.base) if network is None else network_marks(one.field, one.image, network)
            with self.lock:
                state = self._states[number]
                if state.revision == 0:
                    edits, was_saved = state.touched(), state.is_saved
                    edits.history = History(Edit(marks, automatic=True))
                    if was_saved:
                        edits.note_saved()
            return self._frame(number)
        return one

    def automatic(self, number: int) -> FrameEditor:
        """Return a frame to the camera that was found without a person, and to the labels of the network."""
        one, network = self._frame(number), self.network
        return one.automatic(Marks() if network is None else network_marks(one.field, one.image, network))

    def with_marks_of(self, number: int, other: int) -> FrameEditor:
        """Copy the marks of another frame to a frame, moved as the background moves and snapped to paint.

        Raises
        ------
        ValueError
            If the other frame has no marks, or shows no background that this one shows too.
        """
        one, source = self._frame(number), self._frame(other)
        if not len(source.marks):
            raise ValueError(f"frame {self.ids[other]} has no marks to copy: label it first")
        return one.with_marks(moved_marks(source.marks, source.image, one))

    def put(self, number: int, changed: FrameEditor, revision: int | None = None) -> None:
        """Change a frame: its new state is written to the journal, then taken over.

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
            If the change is impossible, as a wrong size of the field; then nothing is changed.
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
            if self._folder is not None:
                self._folder.note_change(number, after)
            state.change(before.changed_to(after), changed.found)

    def __setitem__(self, frame: int | str, changed: FrameEditor) -> None:
        """Change a frame, see `put`."""
        self.put(self._number(frame), changed)

    def set_cuts(self, cuts: Sequence[int]) -> None:
        """Set the first frames of the shots of a clip; the first frame of the clip is always one.

        Raises
        ------
        ValueError
            If this is no clip, or `cuts` are not numbers of its frames.
        """
        if not self.is_clip:
            raise ValueError("expected a clip: pictures have no cuts")
        if not all(0 <= cut < len(self) for cut in cuts):
            raise ValueError(f"expected numbers of frames from 0 to {len(self) - 1} as cuts")
        with self.lock:
            self._states.cuts = sorted({0, *cuts})
            self._states.has_own_cuts = True
            if self._folder is not None:
                self._folder.journal.add(cuts=self.cuts)

    def solve(self, progress: Progress = ignored) -> Proposal:
        """Solve a clip again around the frames that a person has mended; nothing is changed until `keep`.

        Parameters
        ----------
        progress : callable
            Gets the number of frames that are done, of all, and the stage; may raise an error to end the work.

        Raises
        ------
        ValueError
            If this is no clip, or its field is neither known to the network nor has stands, without which it cannot be
            searched for.
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
            self._first_pass = first_pass(self.frames, window, self.field, network, self._run_options, progress)
        cuts = self.cuts if self.has_own_cuts else None
        found = solve(self.frames, self._first_pass, anchors, cuts, self._now, progress)
        in_clip = {n: one for n, one in found.calibrations.items() if n in anchors and one is not anchors[n]}
        told = {n: with_strays(self._states[n].edits.history.present.marks, one) for n, one in in_clip.items()}
        calibrations = {**found.calibrations, **told}
        return replace(found, calibrations=calibrations, revisions={n: revisions[n] for n in found.anchors})

    def next_to_mend(self) -> int | None:
        """Number of the frame of a clip whose labels would help most; None if all cameras are good.

        Raises
        ------
        ValueError
            If it is no clip.
        """
        if not self.is_clip:
            raise ValueError("expected a clip: pictures are mended one by one")
        return next_frame(self.frames, self._states.rows, self.field, self.network)

    def _by_marks(self, number: int) -> Calibration:
        """Calibrate a frame from its marks alone, also if the clip's camera was kept for it."""
        one, state = self._frame(number), self._states[number]
        return replace(one, found=None).calibration if state.is_of_clip else self.fitted(number).calibration

    def _now(self, number: int) -> Calibration | None:
        """The calibration that a frame has now."""
        state = self._states.get(number)
        if state is None:
            return self._stored_calibration(number)
        return state.found if state.is_anchor else state.base

    def keep(self, proposal: Proposal) -> int:
        """Accept a solution of the clip: write its cameras into the folder as `save` does; returns their number.

        The labels of its anchors are written too. Outside the window that was solved everything stays as it was.

        Raises
        ------
        ValueError, ChangedFileError, OSError
            As `save`.
        """
        return self._folder_to_save_to().keep(proposal)

    @property
    def can_undo_keep(self) -> bool:
        """Whether the last save was a `keep`, which can be undone."""
        return self._folder is not None and self._folder.can_undo_keep

    def undo_keep(self) -> Proposal:
        """Undo the last `keep`: restore files and cameras as they were before; returns the solution.

        Changes by a person since then stay. The files of the solution are kept in ``history``.

        Raises
        ------
        ValueError
            If none was kept, or something was saved since.
        ChangedFileError, OSError
            As `save`.
        """
        if self._folder is None:
            raise ValueError(NOTHING_KEPT)
        return self._folder.undo_keep()

    def save(self) -> int:
        """Write labels and cameras into the folder, as ``fieldcalib run`` writes them; returns the number of frames.

        Written are frames that were changed, and frames that were opened and have no result there yet, unless they
        still have to be searched (`search`). Labels by hand go to ``labels/<id>.json``, and into files in the format of
        the given labels. Replaced files are kept in ``history``: `last_save` says where, and which frames could not be
        saved.

        Raises
        ------
        ValueError
            If there is no folder.
        ChangedFileError
            If a file would be replaced that was written neither by a run nor from the page, or that another program has
            changed; then nothing is written.
        UnfinishedSaveError
            If the files were written, but not all could be moved to their places; the next save completes this.
        OSError
            If a file cannot be written; then nothing is changed.
        """
        return self._folder_to_save_to().save(self.fitted)

    def _folder_to_save_to(self) -> Folder:
        if self._folder is None:
            raise ValueError("expected a folder to save to: give Editor(..., out=...)")
        return self._folder

    @property
    def to_draw(self) -> list[str]:
        """Files of a clip that show older cameras, were moved to the history, and can be drawn again."""
        return [] if self._folder is None else self._folder.to_draw

    def draw(self, progress: Progress = ignored) -> list[str]:
        """Draw the files of `to_draw` again from the saved cameras; returns their names.

        If cameras are saved meanwhile, the drawings are outdated, and none is kept.

        Parameters
        ----------
        progress : callable
            As in `solve`.

        Raises
        ------
        OSError
            If a file cannot be written.
        """
        return [] if self._folder is None else self._folder.draw(progress)

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
        return self._folder_to_save_to().save_labels(format)

    def _repr_html_(self) -> str:
        """Show the first frame in a notebook."""
        return self[0]._repr_html_()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the files; all changes are in the journal."""
        self.frames.close()
        if self._folder is not None:
            self._folder.journal.close()
