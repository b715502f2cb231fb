"""Compare what two commits compute: `python -m data_tools.compare_commits OLD [NEW]`.

A refactoring must not change results. Both commits calibrate the same annotated and drawn frames, pictures and short
pieces of clips, each in its own checkout and process. Verdicts, findings and probabilities must be equal, cameras agree
within 1e-3 px over the image and covariances within 1e-5 of the standard deviations; processor times are printed side
by side. NEW is the working tree by default.

    python -m data_tools.compare_commits HEAD~1 --data ../shared/data
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np
import yaml

import fieldcalib as fc
from fieldcalib import fields
from fieldcalib.io.videos import VideoReader

Found: TypeAlias = list[Any]  # results of one part, one for each frame, as JSON

MOST_PIXELS_OFF, MOST_COVARIANCE_OFF, MOST_PROBABILITY_OFF = 1e-3, 1e-5, 1e-6
DEPTHS = (10.0, 300.0)  # m: of the points at which two cameras are compared
EVERY, FRAMES = 4, 60  # every fourth annotated frame is calibrated by itself; frames of a clip


def annotated(folder: Path) -> dict[str, Any]:
    """Read a folder of annotations: file name -> label -> pixels normalised by width and height."""
    records = {path.name: json.loads(path.read_text()) for path in sorted(folder.glob("*.json")) if path.stem.isdigit()}
    return {
        name: {label: [(p["x"], p["y"]) for p in points] for label, points in record.items() if points}
        for name, record in records.items()
    }


def in_pixels(frames: Iterable[Mapping[str, Any]], size: tuple[int, int]) -> list[dict[str, Any]]:
    """Convert normalised labels to pixels, without labels that the field does not have."""
    field = fc.soccer()
    return [
        {label: np.multiply(xy, np.subtract(size, 1)) for label, xy in frame.items() if label.strip() in field}
        for frame in frames
    ]


def drawn(count: int) -> Iterator[Any]:
    """Fields of all sports, each with the labels that `count` cameras beside it see, with 1 px noise."""
    rng = np.random.default_rng(23)
    for name in sorted(fields.FIELDS):
        field = fields.FIELDS[name]()
        for k in range(count):
            C = (rng.uniform(-5.0, 5.0), 0.5 * field.width + rng.uniform(10.0, 30.0), -rng.uniform(6.0, 18.0))
            pan = np.arctan2(rng.uniform(-0.3, 0.3) * field.length - C[0], C[1])
            tilt = np.pi / 2 - np.arctan2(-C[2], C[1])
            camera = fc.Camera.from_angles(pan, tilt, 0.0, rng.uniform(500.0, 1500.0), C, (960, 540))
            seen = {label: camera.project(segment.sample(1.0)) for label, segment in field.items()}
            inside = {label: xy[np.all((xy >= 0.0) & (xy <= (959, 539)), axis=1)] for label, xy in seen.items()}
            yield name, k, field, {s: xy + rng.normal(0.0, 1.0, xy.shape) for s, xy in inside.items() if len(xy) > 1}


def one_by_one(data: Path) -> Found:
    """`calibrate_from_segments` with several sets of options."""
    frames = in_pixels(list(annotated(data / "sncalib-test-center").values())[::EVERY], (960, 540))
    options: list[dict[str, Any]] = [
        {},
        {"flags": fc.PINHOLE_FLAGS},
        {"prior": None},
        {"trust_labels": True},
        {"tau": 0.017},
    ]
    return [
        record(fc.calibrate_from_segments(fc.soccer(), frame, (960, 540), **options[0 if k % 2 else k // 2 % 5]))
        for k, frame in enumerate(frames)
    ]


def batches(data: Path) -> Found:
    """`calibrate_batch` of all annotated frames, without and with weights."""
    found = []
    for folder, size in (("sncalib-test-center", (960, 540)), ("wc14-test", (1280, 720))):
        frames = in_pixels(annotated(data / folder).values(), size)
        found += fc.calibrate_batch(fc.soccer(), frames, size)
    weights = [{label: 1.0 + len(label) % 3 for label in frame} for frame in frames]
    found += fc.calibrate_batch(fc.soccer(), frames, size, weights=weights, loss="huber")
    return [record(one) for one in found]


def sports(data: Path) -> Found:
    """Fields of all sports, with points, arcs and curves."""
    return [
        [name, k, record(fc.calibrate_from_segments(field, pixels, (960, 540)))]
        for name, k, field, pixels in drawn(4)
        if len(pixels) > 1
    ]


def points(data: Path) -> Found:
    """Named points and homographies."""
    found: Found = []
    for k in range(12):
        camera = fc.Camera.from_angles(0.1 * k - 0.5, 1.4, 0.0, 1500.0, (2.0, 65.0, -15.0), (960, 540))
        X = np.array([(x, y, 0.0) for x in np.linspace(-52.5, 52.5, 9) for y in np.linspace(-34.0, 34.0, 5)])
        xy = camera.project(X) + np.random.default_rng(k).normal(0.0, 1.0, (len(X), 2))
        inside = np.all((xy > 0.0) & (xy < (959, 539)), axis=1)
        found.append(record(fc.calibrate_from_points(X[inside], xy[inside], (960, 540))))
        found.append(record(fc.calibrate_from_homography(camera.homography, (960, 540))))
    return found


def sequences(data: Path) -> Found:
    """Frames of one tripod, and of a camera that moves."""
    found: Found = []
    field, rng = fc.soccer(), np.random.default_rng(5)
    for shared in (None, ("principal point", "zoom law", "field size")):
        frames = []
        for t in range(40):
            C = (0.02 * t, 60.0, -14.0) if shared else (1.0, 60.0, -14.0)
            camera = fc.Camera.from_angles(0.02 * t - 0.4, 1.36, 0.0, 1500.0 + 5.0 * t, C, (960, 540), k=(-0.1, 0.0))
            seen = {label: camera.project(segment.sample(3.0)) for label, segment in field.items()}
            inside = {label: xy[np.all((xy >= 0.0) & (xy <= (959, 539)), axis=1)] for label, xy in seen.items()}
            kept = {label: xy + rng.normal(0.0, 1.0, xy.shape) for label, xy in inside.items() if len(xy) > 1}
            frames.append(kept if t % 9 else {})
        how: dict[str, Any] = {} if shared is None else {"shared": shared}
        found += map(record, fc.calibrate_sequence(field, frames, (960, 540), **how))
    return found


def pictures(data: Path) -> Found:
    """`calibrate_from_images`, with the size of the pitch unknown and given."""
    network, found = fc.SegmentationNetwork.load(threads=1), []
    for folder in ("sncalib-images", "offside-stills", "images", "mls-squashed"):
        images: list[Any] = [cv2.imread(str(path)) for path in sorted((data / folder).glob("*.jpg"))]
        found += fc.calibrate_from_images(fc.soccer(), images, network)
        if folder == "sncalib-images":
            found += fc.calibrate_from_images(fc.soccer(length=105.0, width=68.0), images[::3], network)
    return [record(one) for one in found]


def clips(data: Path) -> Found:
    """`calibrate_video` of pieces of all clips, `Tracker` on one of them."""
    network, found = fc.SegmentationNetwork.load(threads=1), []
    for path in sorted((data / "clips").glob("*.mp4")):
        with VideoReader(path) as video:
            frames = list(islice(video, FRAMES))
        found += [[path.stem, record(one)] for one in fc.calibrate_video(fc.soccer(), frames, network)]
        if path.stem in ("el-clasico", "israel"):
            tracker = fc.Tracker(fc.soccer(), network, wait=True)
            found += [[f"{path.stem}, live", record(tracker.update(image))] for image in frames[:40]]
    return found


def courts(data: Path) -> Found:
    """Courts found by search: some frames of clips by themselves, and a piece of one as a clip."""
    found: Found = []
    for path in sorted((data / "courts").glob("*.mp4")):
        field = fields.FIELDS[path.stem.split("-")[0]]()
        with VideoReader(path) as video:
            frames = list(islice(video, FRAMES))
        found += [[path.stem, record(one)] for one in fc.calibrate_from_images(field, frames[::20])]
        if path.stem == "tennis-4":
            found += [[f"{path.stem}, clip", record(one)] for one in fc.calibrate_video(field, frames[:24:2])]
    return found


def wild(data: Path) -> Found:
    """Pictures and the beginnings of clips as people have them, of several fields."""
    network, found = fc.SegmentationNetwork.load(threads=1), []
    for name, field_name, *_ in yaml.safe_load((data / "wild" / "expected.yaml").read_text()):
        path, field = data / "wild" / name, fields.FIELDS[field_name]()
        chosen = network if field_name == "soccer" else None
        if path.suffix in (".mp4", ".gif"):
            with VideoReader(path) as video:
                frames = list(islice(video, 12))
            found += [[name, record(one)] for one in fc.calibrate_video(field, frames, chosen)]
            continue
        image = cv2.imread(str(path))  # also where the commit refuses the file
        if image is None:
            raise ValueError(f"{path} cannot be read")
        found += [[name, record(one)] for one in fc.calibrate_from_images(field, [np.asarray(image, np.uint8)], chosen)]
    return found


PARTS: dict[str, Callable[[Path], Found]] = {
    part.__name__: part for part in (one_by_one, batches, sports, points, sequences, pictures, clips, courts, wild)
}


def record(one: fc.Calibration) -> dict[str, Any]:
    """Record the quantities of a calibration that are compared."""
    camera = one.camera
    lens = None if camera is None else [*camera.K.tolist(), *camera.R.tolist(), camera.C.tolist(), camera.dist.tolist()]
    return {
        "said": [str(one.verdict), str(one.status), one.remedy, [str(s) for s in one.suspect_labels]],
        "findings": [[str(found.what), found.about] for found in one.findings] if hasattr(one, "findings") else None,
        "camera": lens,
        "image_size": None if camera is None else list(camera.image_size),
        "errors_px": list(one.per_segment_errors.values()),
        "covariance": one.covariance.tolist() if one.knows_errors else None,
        "probability": one.probability() if one.has_probability else None,
    }


def measure(data: Path, parts: Sequence[str], out: Path) -> None:
    """Run the parts in this checkout and write one line of JSON for each."""
    with out.open("w") as lines:
        for name in parts:
            began = time.process_time()
            found = PARTS[name](data)
            lines.write(json.dumps({"part": name, "seconds": time.process_time() - began, "found": found}) + "\n")
            lines.flush()


def pixels_off(old: Mapping[str, Any], new: Mapping[str, Any]) -> float:
    """Largest distance in pixels between the images of the same points under two cameras."""
    a, b = (
        fc.Camera(one["camera"][:3], one["camera"][3:6], one["camera"][6], one["image_size"], one["camera"][7])
        for one in (old, new)
    )
    width, height = old["image_size"]
    x, y = np.meshgrid(np.linspace(0.0, width - 1.0, 9), np.linspace(0.0, height - 1.0, 6))
    xy = np.column_stack([x.ravel(), y.ravel()])
    rays = np.column_stack([cv2.undistortPoints(xy[:, None], a.K, a.dist)[:, 0], np.ones(len(xy))]) @ a.R
    X = np.concatenate([a.C + depth * rays for depth in DEPTHS])
    off = np.linalg.norm(b.project(X) - a.project(X), axis=1)
    return float(np.max(off[np.isfinite(off)], initial=0.0))


def differences(old: Any, new: Any) -> Iterator[tuple[str, float]]:
    """Differences of two records, each as a share of its tolerance."""
    if isinstance(old, list):
        if old[:-1] != new[:-1]:
            yield f"another frame: {old[:-1]}, {new[:-1]}", np.inf
        old, new = old[-1], new[-1]
    if old["said"] != new["said"]:
        yield f"said: {old['said']} -> {new['said']}", np.inf
    found = old.get("findings"), new.get("findings")
    if None not in found and found[0] != found[1]:  # earlier commits have none
        yield f"findings: {found[0]} -> {found[1]}", np.inf
    if any((old[name] is None) != (new[name] is None) for name in ("camera", "covariance", "probability")):
        yield "there in one of them only", np.inf
        return
    if old["camera"] is not None:
        yield "camera", pixels_off(old, new) / MOST_PIXELS_OFF
    if old["covariance"] is not None:
        V, W = np.array(old["covariance"]), np.array(new["covariance"])
        if V.shape != W.shape:
            yield f"covariance of {V.shape}, {W.shape}", np.inf
        else:
            sd = np.sqrt(np.maximum(np.diag(V), 1e-300))
            yield "covariance", float(np.max(np.abs(W - V) / np.outer(sd, sd), initial=0.0)) / MOST_COVARIANCE_OFF
    if old["probability"] is not None and new["probability"] is not None:
        yield "probability", abs(old["probability"] - new["probability"]) / MOST_PROBABILITY_OFF


def compare(old: Path, new: Path, show: int) -> bool:
    """Print the differences of two measurements; returns whether they agree."""
    agree = True
    for before, after in zip(*(map(json.loads, path.read_text().splitlines()) for path in (old, new)), strict=True):
        largest: dict[str, float] = {}
        off: list[str] = []
        for k, (a, b) in enumerate(zip(before["found"], after["found"], strict=True)):
            for what, share in differences(a, b):
                name = what.split(":")[0]
                largest[name] = max(largest.get(name, 0.0), share)
                if not share <= 1.0:
                    off.append(f"    {k}: {what} {share:.3g}")
        same = "bit for bit" if before["found"] == after["found"] else f"{largest}"
        ratio = after["seconds"] / before["seconds"]
        print(f"{before['part']}: {len(after['found'])} frames, {'DIFFER' if off else 'agree'} ({same}), ", end="")
        print(f"time x {ratio:.2f} ({before['seconds']:.1f} s before)")
        print(*off[:show], sep="\n", end="\n" if off else "")
        agree &= not off
    return agree


@contextmanager
def checkout(commit: str | None) -> Iterator[Path]:
    """The files of a commit in a temporary folder; the working tree itself for None."""
    if commit is None:
        yield Path.cwd()
        return
    if Path(commit).is_dir():
        yield Path(commit).resolve()
        return
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(["git", "worktree", "add", "--quiet", "--detach", folder, commit], check=True)
        try:
            yield Path(folder)
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", folder], check=True)


def main() -> int:
    """Measure both commits and compare."""
    parser = argparse.ArgumentParser(description="Compare what two commits compute.")
    parser.add_argument("old", help="a commit, a folder with a checkout, or a file of an earlier --keep")
    parser.add_argument("new", nargs="?", help="the same; the working tree by default")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--keep", type=Path, help="keep what the new commit finds in this file")
    parser.add_argument("--show", type=int, default=10, help="differences of each part that are listed")
    parser.add_argument("--measure", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure is not None:
        measure(options.data, options.parts, options.measure)
        return 0
    with tempfile.TemporaryDirectory() as folder:
        files: list[Path] = []
        for commit in (options.old, options.new):
            out = Path(folder, f"{len(files)}.jsonl")
            if commit is not None and Path(commit).is_file():
                kept = {json.loads(line)["part"]: line for line in Path(commit).read_text().splitlines(keepends=True)}
                out.write_text("".join(kept[part] for part in options.parts))
            else:
                with checkout(commit) as tree:
                    command = [sys.executable, "-P", __file__, "-", "--data", str(options.data.resolve())]
                    command += ["--parts", *options.parts, "--measure", str(out)]
                    subprocess.run(command, check=True, cwd=tree, env={**os.environ, "PYTHONPATH": str(tree)})
            files.append(out)
        if options.keep is not None:
            options.keep.write_text(files[1].read_text())
        return 0 if compare(files[0], files[1], options.show) else 1


if __name__ == "__main__":
    sys.exit(main())
