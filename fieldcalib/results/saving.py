"""Results written to a folder, by the writer of the command line."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fieldcalib.assess.findings import Verdict
from fieldcalib.assess.placement import Placement
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.draw.overlays import draw_calibration
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.images.clip.from_video import PART
from fieldcalib.io.files import can_name_files, whole_file
from fieldcalib.io.formats import OVERLAYS, VIDEOS
from fieldcalib.io.image import Image
from fieldcalib.io.image_files import IMAGES_AT_ONCE
from fieldcalib.io.output_folder import check_targets, output_folder
from fieldcalib.io.results import LINES, SOLVER, TABLE
from fieldcalib.results.collection import Results
from fieldcalib.run_folder.clip_results import write_clip, write_clip_results
from fieldcalib.run_folder.frame_record import Outcome, camera_file, is_squashed
from fieldcalib.run_folder.frame_source import ClipInput, whole_frame
from fieldcalib.run_folder.labelled_frames import CAMERA_FILES, WITHHELD
from fieldcalib.run_folder.record import ID, RECORD, RunOptions, RunRecord
from fieldcalib.run_folder.results import (
    OVERLAY,
    SHARED_FILES,
    SUMMARY,
    ResultsWriter,
    UsedFolderError,
    finish,
    open_run_folder,
)

LABELLED = "calibrate"  # the command of results of labelled pixels


def save(results: Results, out: Path, *, overwrite: bool, overlays: bool) -> None:
    """Write results to a folder, see `Results.save`."""
    if results.folder is not None:
        _copy(results, results.folder, out, overwrite=overwrite, overlays=overlays)
        return
    began = time.perf_counter()
    run, record = _record(results, out, overwrite=overwrite)
    overlays = overlays and results.command != LABELLED
    with _python_words(), open_run_folder(run, record, files=results.pictures.files) as writer:
        if results.video is not None:
            _write_clip(results, results.video, writer, overlays=overlays)
        else:
            _write_frames(results, writer, overlays=overlays)
        finish(out, writer.summary(run.recorded, time.perf_counter() - began))


@contextmanager
def _python_words() -> Iterator[None]:
    """Say of a folder that is used already what to give in Python."""
    try:
        yield
    except UsedFolderError as error:
        raise _used(error.found) from None


def _used(found: str) -> FileExistsError:
    return FileExistsError(f"{found}: give overwrite=True to replace them, or another folder")


def _record(results: Results, out: Path, *, overwrite: bool) -> tuple[RunOptions, RunRecord]:
    """The options and the record of the run that the results count as."""
    pictures = results.pictures
    options = json.loads(json.dumps({**results.options, "input": list(pictures.paths)}, default=str))
    run = RunOptions(out, options, results.command, overwrite=overwrite)
    is_alone = results.video is None and not pictures.is_video and results.command != LABELLED
    writes = (*CAMERA_FILES, OVERLAYS.file_name(ID)) if is_alone else CAMERA_FILES
    unit = IMAGES_AT_ONCE if results.video is None else PART
    return run, RunRecord.of(run, pictures.files, unit=unit, writes=writes)


@dataclass(frozen=True)
class _Whole:
    """How results of whole frames are written and drawn."""

    results: Results
    draws = True

    def placement(self, image: Image) -> Placement:
        return whole_frame(image)

    def outcome(self, id: str, calibration: Calibration, **more: Any) -> Outcome:
        line = self.results.line(id)
        is_labelled = self.results.command == LABELLED
        keeps = line["status"] not in WITHHELD if is_labelled else line["verdict"] != Verdict.REJECT
        files = dict(more.get("files", {}))
        if keeps and calibration.camera is not None:
            files |= camera_file(id, calibration.camera)
        return Outcome(line, is_squashed(line), files)

    def drawn(self, image: Image, calibration: Calibration) -> Image:
        return draw_calibration(image, calibration, calibration.field or soccer())


def _write_clip(results: Results, video: VideoCalibration, writer: ResultsWriter, *, overlays: bool) -> None:
    """Write a clip, with its pictures where they can be read again."""
    options = _Whole(results)
    if overlays and results and results.pictures.has(next(iter(results))):
        write_clip_results(writer, ClipInput(results.pictures.frames(), progress=False), video, options)
        return
    for id in results.frames.ids:
        broken = id in results.broken
        writer.add(_broken(results, id) if broken else options.outcome(id, results[id]))
    writer.notes = video.remarks
    write_clip(writer.out, video, results.frames_per_second or 0.0)


def _write_frames(results: Results, writer: ResultsWriter, *, overlays: bool) -> None:
    """Write frames that were calibrated one by one, with their pictures where they can be read again."""
    options, writer.notes = _Whole(results), results.notes
    if overlays and results.pictures.is_video:
        path, source = writer.out / OVERLAY, results.pictures.frames()
        with VIDEOS.write(path, source.frames_per_second) as video:
            for frame in source:
                if frame.image is not None and frame.id in results:
                    video.write(options.drawn(frame.image, results[frame.id]))
        overlays = False
    for id in results.frames.ids:
        if id in results.broken:
            writer.add(_broken(results, id))
            continue
        files = {}
        if overlays and results.pictures.has(id):
            picture = options.drawn(results.image(id), results[id])
            files[OVERLAYS.file_name(id)] = OVERLAYS.write(picture)
        writer.add(options.outcome(id, results[id], files=files))


def _broken(results: Results, id: str) -> Outcome:
    """The outcome of a frame that could not be read, which is no news."""
    return Outcome({"id": id, "status": "broken file", "message": results.broken[id]})


def _copy(results: Results, folder: Path, out: Path, *, overwrite: bool, overlays: bool) -> None:
    """Copy the files of a run, its record first and its summary last."""
    names = [RECORD, SOLVER, LINES, TABLE]
    patterns = list(CAMERA_FILES) + ([OVERLAYS.file_name(ID)] if overlays else [])
    ids = [id for id in results.frames.ids if can_name_files(id)]
    names += [pattern.replace(ID, id) for pattern in patterns for id in ids]
    names += [name for name in SHARED_FILES if name != SUMMARY and (overlays or name != OVERLAY)]
    with output_folder(out):
        if out.samefile(folder):
            return
        there = next((name for name in (RECORD, LINES, TABLE, SUMMARY) if (out / name).exists()), None)
        if there is not None and not overwrite:
            raise _used(f"{out} holds results already, as {there}")
        check_targets(
            [out / name for name in (*names, SUMMARY)],
            [folder / name for name in names],
            replaces=overwrite,
            remedy="give overwrite=True to replace it, or another folder",
        )
        for name in (*names, SUMMARY):
            if (folder / name).is_file():
                with whole_file(out / name) as copy, (folder / name).open("rb") as file:
                    shutil.copyfileobj(file, copy)
            else:
                (out / name).unlink(missing_ok=True)
