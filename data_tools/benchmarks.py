"""The commands of docs/benchmarks.md with their data, so that what two commits print can be compared.

    python -m data_tools.benchmarks OUT [WORD...] [--data DIR]
    diff -r BEFORE AFTER

Each of `COMMANDS` whose name has one of the words in it is run in a shell, and what it prints goes to
``OUT/<name>.txt``. A name whose file is there is passed over, so that a run that was stopped goes on where it was.
Printed are the names, with the seconds that each took: all of them take hours. What is rendered or calibrated on the
way is in ``OUT/made``.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from fieldcalib.console.program import run_command

# name: what is run. $DATA is the folder of data sets, $MADE that of what is made, $WC22 the measured cameras of 2022
COMMANDS = """
tables: python -m baselines.tables --sncalib $DATA/sncalib-test-center --wc14 $DATA/wc14-test
left-out-soccernet: python -m data_tools.leave_one_out $DATA/sncalib-test-center --size 960x540
left-out-wc14: python -m data_tools.leave_one_out $DATA/wc14-test --size 1280x720
left-out-wc14-any-size: python -m data_tools.leave_one_out $DATA/wc14-test --size 1280x720 --free-field-size
ground-errors: python -m data_tools.ground_errors $DATA/sncalib-test-center --size 960x540
measured-cameras: python -m data_tools.measured_cameras $WC22
sequences: python -m data_tools.sequences $WC22
sequences-matches: python -m data_tools.sequences $WC22 --matches
sequences-flies: python -m data_tools.sequences $WC22 --flies
sequences-flies-matches: python -m data_tools.sequences $WC22 --flies --matches
rigs-labels: python -m data_tools.rigs labels
rigs-labels-known: python -m data_tools.rigs labels --known
rigs-pictures: python -m data_tools.rigs pictures --rigs 50
clip-CLIP: python -m fieldcalib run $DATA/clips/CLIP.mp4 --no-pictures --out $MADE/CLIP
drift-FOLLOWED: python -m data_tools.clips $DATA/clips/FOLLOWED.mp4 --flow --jitter
drift-measured: python -m data_tools.clips $WC22/ARG_CRO_000737.mp4 --flow --jitter
halves-HALVED: python -m data_tools.clips $DATA/clips/HALVED.mp4 --every-third-second --halves
measured-clip: python -m data_tools.score_images clip $WC22/ARG_CRO_000737.mp4 $WC22/ARG_CRO_000737.npz
feet: python -m data_tools.feet --clips 12
film-ZOOM: python -m data_tools.synthetic --clip $MADE/ZOOM.mp4 --frames 120 --seed INDEX --measured $WC22/ZOOM.npz
filmed: python -m data_tools.filmed $MADE/???_???_??????.mp4
wrong-labels-soccernet: python -m data_tools.wrong_labels $DATA/sncalib-test-center --size 960x540
wrong-labels-soccernet-two: python -m data_tools.wrong_labels $DATA/sncalib-test-center --size 960x540 --wrong 2
wrong-labels-wc14: python -m data_tools.wrong_labels $DATA/wc14-test --size 1280x720
wrong-labels-wc14-two: python -m data_tools.wrong_labels $DATA/wc14-test --size 1280x720 --wrong 2
verdicts: python -m data_tools.verdicts $DATA/sncalib-test-center --size 960x540
spoiled-labels: python -m data_tools.spoiled_labels $DATA/sncalib-test-center --size 960x540
undeclared-labels: python -m data_tools.undeclared $DATA/sncalib-test-center --size 960x540
undeclared-shapes: python -m data_tools.undeclared $DATA/sncalib-test-center --size 960x540 --shapes
undeclared-images: python -m data_tools.undeclared --images $DATA/sncalib-images
windows-rendered: python -m data_tools.pictures_in_pictures rendered --frames 15
enlarged: python -m data_tools.pictures_in_pictures enlarged $DATA/offside-stills $DATA/sncalib-images $DATA/images
windows-clips: python -m data_tools.pictures_in_pictures clips --clips 3 --frames 30
stills-FOLDER: python -m fieldcalib run $DATA/FOLDER --no-pictures --out $MADE/FOLDER
smaller-rendered: python -m data_tools.smaller_pitches rendered
smaller-clips: python -m data_tools.smaller_pitches clips --clips 4 --frames 10
probability-sizes: python -m data_tools.probability sizes
probability-measured: python -m data_tools.probability measured $WC22 --repeats 30
probability-annotated: python -m data_tools.probability annotated $DATA/sncalib-test-center --size 960x540
pitches-pictures: python -m data_tools.pitches pictures --frames 1000 --seed 1
pitches-clips: python -m data_tools.pitches clips --clips 120
size-wc14: fieldcalib calibrate $DATA/wc14-test --size 1280x720 --out $MADE/w --field-size estimated --same-field
sides: python -m data_tools.sides
keypoints: python -m data_tools.score_images keypoints $DATA/pitch-keypoints/valid
homographies: python -m data_tools.score_images homographies $DATA/wc14-images-256/test $DATA/wc14-test
nonsense: python -m data_tools.score_images nonsense
sports-SPORT: python -m data_tools.probability --seed 7 verdicts --field SPORT --frames 300
courts-clips: python -m data_tools.score_courts clips $DATA/courts
courts-basketball-FIRST: python -m data_tools.score_courts basketball $DATA/basketball-cameras/*.json --first FIRST
courts-rinks: python -m data_tools.score_courts rinks $DATA/hockey-points
courts-tripod: python -m data_tools.score_tripod $DATA/hockey-points
courts-halls: python -m data_tools.score_courts halls $DATA/hall-cameras
courts-COURT: python -m data_tools.score_courts frames --field COURT --seed 2000 --least-view 0.333 --frames 12
photographs: python -m data_tools.photographs take --field tennis --frames 8 --seed 6000
photographs-action: python -m data_tools.photographs take --field tennis --kind action --frames 60 --seed 100
photographs-drone: python -m data_tools.photographs take --field tennis --kind drone --frames 60 --seed 100
clicks: python -m data_tools.clicks $DATA/images $MADE/images --repeats 5
mend-clips: python -m data_tools.mend_clips $MADE/mended --seeds 4
"""

# words that stand for one command each, whose number is INDEX
EACH = {
    "CLIP": "anfield behind-goal chelsea-milan city-united el-clasico gdynia israel moving-window one-end pan-to-goal "
    "roma snmot060",
    "FOLLOWED": "behind-goal chelsea-milan el-clasico israel pan-to-goal snmot060",
    "HALVED": "el-clasico israel snmot060",
    "ZOOM": "ARG_CRO_000737 ARG_FRA_183303 BRA_KOR_230503 CRO_MOR_182145 CRO_MOR_193052 ENG_FRA_223104 ENG_FRA_231427 "
    "FRA_MOR_221546 MOR_POR_184642 NET_ARG_003203",
    "FOLDER": "images mls-squashed offside-stills sncalib-images",
    "SPORT": "american-football-ncaa american-football-nfl badminton basketball-fiba basketball-nba field-hockey "
    "futsal handball ice-hockey-iihf ice-hockey-nhl ice-hockey-nhl-2013 padel rugby-union tennis volleyball",
    "FIRST": "0 3 5",
    "COURT": "american-football-nfl basketball-3x3 basketball-half basketball-ncaa basketball-nfhs beach-volleyball "
    "field-hockey futsal handball lacrosse-men pickleball rugby-league rugby-union soccer-5v5 soccer-7v7 soccer-9v9",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the commands, one after the other."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("words", nargs="*", metavar="WORD", help="in names (all of them)")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"), help="(../shared/data)")
    parser.set_defaults(run=run)
    return run_command(parser.parse_args(arguments))


def run(options: argparse.Namespace) -> int:
    """Run what is not there yet; returns 1 if a command failed, of which nothing is kept."""
    names = [name for name, _ in commands()]
    if unknown := [word for word in options.words if not any(word in name for name in names)]:
        raise ValueError(f"no command has {unknown[0]!r} in its name: expected words of {', '.join(names)}")
    if not options.data.is_dir():
        raise ValueError(f"{options.data} is no folder: --data is that of the data sets")
    data, made = options.data.resolve(), (options.out / "made").resolve()
    made.mkdir(parents=True, exist_ok=True)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    known = {"DATA": str(data), "MADE": str(made), "WC22": str(data / "worldcup2022-cameras"), "PATH": path}
    failed = False
    for name, command in commands():
        kept = options.out / f"{name}.txt"
        if kept.exists() or not any(word in name for word in options.words or [""]):
            continue
        began = time.perf_counter()
        done = subprocess.run(
            command, shell=True, stdout=subprocess.PIPE, text=True, check=False, env={**os.environ, **known}
        )
        if done.returncode == 0:
            kept.write_text(done.stdout.replace(str(made), "MADE"))
        print(f"{name}: {'failed, ' * (done.returncode != 0)}{time.perf_counter() - began:.0f} s", flush=True)
        failed |= done.returncode != 0
    return int(failed)


def commands() -> Iterator[tuple[str, str]]:
    """Yield names and commands."""
    for line in COMMANDS.strip().splitlines():
        each = next((word for word in EACH if word in line), "")
        for index, one in enumerate(EACH[each].split() if each else [""]):
            name, command = (line.replace(each, one) if each else line).replace("INDEX", str(index)).split(": ", 1)
            yield name, command


if __name__ == "__main__":
    sys.exit(main())
