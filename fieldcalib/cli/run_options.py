"""The options of `fieldcalib run`: its input, the folder of its results, and how frames are calibrated and drawn."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast, get_args

from fieldcalib.assess.findings import UP_TO_SIDE
from fieldcalib.assess.result import Calibration
from fieldcalib.cli.camera_options import KnownCamera
from fieldcalib.console.arguments import NetworkOptions, cut_of, field_of, prior_of, run_options
from fieldcalib.console.options import given, option, switch
from fieldcalib.draw.overlays import draw_calibration
from fieldcalib.fields.field import SIDES, Field, Side
from fieldcalib.images.from_images import How, Mount
from fieldcalib.io.frame_range import Cut
from fieldcalib.io.frame_source import ReadImage, is_clip, is_video, videos_in
from fieldcalib.io.image_files import Image, check_pixels, size_of
from fieldcalib.io.streams import Input, Stream
from fieldcalib.localize import Network
from fieldcalib.problem.picture_shape import Placement
from fieldcalib.run_folder.record import ESTIMATED, Outcome, RunOptions
from fieldcalib.run_folder.results import REPORT
from fieldcalib.solve.request import Task
from fieldcalib.solve.solver_options import Prior

IMAGE_FOLDER = "images"  # folder of the results of images, beside those of videos
TRIPOD = "tripod"


@dataclass(frozen=True)
class RunRequest:
    """Images, or one video or stream, and all options of `fieldcalib run`."""

    input: Sequence[Input]
    cut: Cut
    run: RunOptions
    field: Field
    prior: Prior
    known: KnownCamera
    network: NetworkOptions
    most_bytes: float
    most_pixels: float
    estimate_size: bool
    """Whether the size of the field is estimated."""
    same_field: bool
    """Whether all images show one field."""
    refine: bool = option(
        "do not look for the white lines in the image: quicker, and less exact",
        name="--no-refinement",
        default=True,
        action="store_false",
    )
    clip: bool = switch("the images are a clip, in the order of the numbers in their names", exclusive="together")
    independent: bool = switch(
        "calibrate each frame of a video by itself, as --no-refinement does too", exclusive="together"
    )
    camera: Mount = option(
        "what a clip is taken by: one on a tripod, whose place is fixed (default), or a drone, one on wires or a hand, "
        "whose path is smooth",
        default=TRIPOD,
        choices=get_args(Mount),
    )
    side: Side | None = option(
        "the side of the field that the camera is on: main (in front of the near touchline or behind the left end, the "
        "default) or opposite (beyond the far one or behind the right end)",
        choices=SIDES,
    )
    send: Sequence[str] | None = option(
        "send the camera of each frame of a stream by UDP, as it comes: json://HOST:PORT for lines of cameras.jsonl, "
        "freed://HOST:PORT for FreeD (D1, a sensor 36 mm wide, no rejected cameras); may be given several times",
        action="append",
        metavar="ADDRESS",
    )
    same_camera: str | None = option(
        "one camera on a tripod took all images: courts that are found in some tell where to search in others; DIR: "
        "earlier results, whose good cameras are recognised by their paint, also if they moved a little",
        nargs="?",
        const="",
        metavar="DIR",
    )
    report: bool = switch(f"write {REPORT} too: one file for any browser")
    keep_rejected: bool = switch("count the best camera of every frame, whatever the verdict says")
    draws: bool = option(
        "draw nothing: no overlays, no plot, no sheet of the worst frames",
        name="--no-pictures",
        default=True,
        action="store_false",
        exclusive="drawing",
    )
    show_paint: bool = switch(
        "draw markings that lie beside their paint in orange, and those without any in grey", exclusive="drawing"
    )

    @classmethod
    def of(cls, options: argparse.Namespace) -> RunRequest:
        """Take the options of a command line.

        Raises
        ------
        ValueError
            If they contradict each other.
        """
        return given(
            cls,
            options,
            cut=cut_of(options),
            run=run_options(options),
            field=field_of(options),
            prior=prior_of(options),
            known=given(KnownCamera, options),
            network=NetworkOptions.of(options),
            estimate_size=options.field_size == ESTIMATED,
        )

    def how(self, network: Network | None = None) -> How:
        """How the frames are calibrated."""
        return How(
            Task(self.field, self.known.given, self.known.flags(self.prior), prior=self.prior),
            network,
            self.side,
            refine=self.refine,
            estimate_aspect=self.known.is_aspect_estimated,
            estimate_size=self.estimate_size,
            may_be_enlarged=self.known.may_be_enlarged,
            camera=self.camera,
            declared=self.known.declared,
        ).of_part(self.known.crop_of)

    @property
    def read(self) -> ReadImage:
        """Reader of images that refuses those that cannot lie in a frame as declared."""
        return ReadImage(self.most_bytes, self.most_pixels, self.placement)

    def placement(self, image: Image) -> Placement:
        """Placement of an image in its frame; a BrokenFileError if that is not possible."""
        placement = self.known.placement(size_of(image))
        check_pixels(placement.frame_size, self.most_pixels)
        self.known.check(placement.frame_size)
        return placement

    @property
    def notes(self) -> tuple[str, ...]:
        """What is said once of the cameras of all pictures."""
        on, _ = self.how().on_side()
        return (UP_TO_SIDE,) if on.is_open else ()

    def outcome(self, id: str, calibration: Calibration, **more: Any) -> Outcome:
        """The outcome of a frame; `more` are keywords of `Outcome.of`."""
        return Outcome.of(id, calibration, **more)

    def drawn(self, image: Image, calibration: Calibration) -> Image:
        """An overlay of a calibration on its image."""
        return draw_calibration(image, calibration, calibration.field or self.field, show_paint=self.show_paint)

    @property
    def paths(self) -> Sequence[Path]:
        """The input, which is no stream."""
        return cast(Sequence[Path], self.input)

    @property
    def is_video(self) -> bool:
        """Whether the input is a file of a video."""
        return is_video(self.input[0])

    @property
    def is_stream(self) -> bool:
        """Whether the input is a stream."""
        return isinstance(self.input[0], Stream)

    @property
    def is_clip(self) -> bool:
        """Whether frames are calibrated together: those of a video by default, images with --clip."""
        return is_clip(self.input[0], together=self.clip, alone=self.independent or not self.refine)

    def check(self) -> None:
        """Raise a ValueError if options do not fit the input."""
        if self.send and not self.is_stream:
            raise ValueError("--send is of streams; of files, fieldcalib export --format freed writes packets")
        if self.camera != TRIPOD and not self.is_clip:
            raise ValueError("--camera is of clips: give a video, or images with --clip, without --independent")
        if self.same_camera is not None and (self.is_clip or self.is_video):
            raise ValueError("--same-camera is of images: the frames of a clip are of one tripod anyway")
        if self.same_camera and self.same_field:
            raise ValueError("--same-camera DIR has cameras on a field of their own size: leave --same-field out")
        if self.same_field and (not self.estimate_size or self.is_video):
            raise ValueError(f"--same-field is of images, with --field-size {ESTIMATED}: a clip shows one field anyway")

    def check_place(self, *, is_searched: bool) -> None:
        """Raise a ValueError if images cannot be those of one camera."""
        if self.same_camera == "" and not is_searched:
            raise ValueError(
                "--same-camera is of fields that the network does not know: give the images as a clip, with --clip"
            )

    def of_input(self, input: Sequence[Input], folder: str = "") -> RunRequest:
        """A copy for another input, whose results go to a folder in --out."""
        run = self.run.changed(self.run.out / folder if folder else self.run.out, input=input)
        return replace(self, input=input, run=run)

    def in_one_thread(self, jobs: int = 1) -> RunRequest:
        """A copy for one of several processes, with one thread, and `jobs` processes of its own."""
        run = replace(self.run.changed(self.run.out, threads=1), jobs=jobs)
        return replace(self, run=run, network=replace(self.network, threads=1))


def split_request(request: RunRequest) -> list[RunRequest]:
    """The request of each run: one for each video and stream, and one for all images.

    Where there are several, or they come from a folder, each has its own folder in --out, by the name of its video.

    Raises
    ------
    ValueError
        If two of them have the same name.
    """
    inputs = [part for one in request.input for part in videos_in(one)]
    images = [one for one in inputs if not _has_own_folder(one)]
    groups = [(one.stem if isinstance(one, Path) else one.name, [one]) for one in inputs if _has_own_folder(one)]
    if images:
        groups.insert(0, (IMAGE_FOLDER, images))
    if len(groups) == 1 and inputs == request.input:  # one video of a folder may be joined by others
        return [request.of_input(groups[0][1])]
    seen: dict[str, Sequence[Input]] = {}
    for name, (first, *_) in groups:
        other = seen.setdefault(name.casefold(), [first])[0]
        if other is not first:
            raise ValueError(f"{other} and {first} would both write to {request.run.out / name}: run them one by one")
    return [request.of_input(part, name) for name, part in groups]


def _has_own_folder(one: Input) -> bool:
    """Whether an input is a run of its own: a video or a stream."""
    return isinstance(one, Stream) or is_video(one)
