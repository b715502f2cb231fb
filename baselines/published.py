"""Published numbers: the tables of TVCalib (Theiner, Ewerth, WACV 2023), and scores of PnLCalib's released results.

Every row names the source of the segments ("GT": annotations, "pred": a network, "PnLCalib": points and lines that
PnLCalib's networks found, "images": the method finds them itself, "-": none are used) and the method that makes a
camera or a homography from them. Accuracies, completeness and scores are in percent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

DatasetName: TypeAlias = Literal[
    "SN-Calib-test-center", "WC14-test", "SN-Calib-test-center, pictures", "WC14-test, pictures"
]
Segments: TypeAlias = Literal["GT", "pred", "PnLCalib", "images", "-"]
Evaluated: TypeAlias = Literal["camera", "homography"]

OURS = "fieldcalib"
OURS_PINHOLE = "fieldcalib, pinhole"
TVCALIB = "TVCalib"
DLT = "DLT lines"
ANNOTATED = "annotated H"
CHEN = "Chen and Little"
CHEN_WIDER = "Chen and Little (U_FoV + U_xyz)"  # its database has a wider distribution of cameras
JIANG = "Jiang et al."
PNLCALIB = "PnLCalib"
TAU = 0.019
LENS = " + lens"
FAR = ", zeta = 1000"  # px; in the other rows zeta is 100

# Number of images of the test split, and of those from the main camera, on which the SN-Calib tables are computed.
SN_TEST, SN_TEST_CENTER = 2719, 1454


def hdecomp(source: str) -> str:
    """Name the method that decomposes the homographies of `source`."""
    return f"HDecomp + {source}"


@dataclass(frozen=True)
class Published:
    """One row of a table."""

    dataset: DatasetName
    evaluated: Evaluated
    method: str
    segments: Segments
    tau: float | None
    ac5: float
    ac10: float
    ac20: float
    cr: float
    cs: float
    iou_part: tuple[float, float] | None = None
    """Mean and median."""


_SN: DatasetName = "SN-Calib-test-center"
_WC: DatasetName = "WC14-test"

ROWS: tuple[Published, ...] = (
    # table "Results on SN-Calib-test-center", upper half
    Published(_SN, "camera", TVCALIB, "GT", TAU, 68.7, 88.0, 96.1, 92.8, 76.9),
    Published(_SN, "camera", TVCALIB, "GT", None, 65.3, 84.2, 92.6, 100.0, 75.5),
    Published(_SN, "camera", hdecomp(CHEN_WIDER), "GT", None, 53.7, 77.5, 88.4, 80.3, 65.1),
    Published(_SN, "camera", hdecomp(DLT), "GT", None, 48.1, 68.5, 84.6, 79.8, 60.2),
    Published(_SN, "camera", TVCALIB, "pred", TAU, 57.6, 81.7, 93.2, 93.7, 72.6),
    Published(_SN, "camera", TVCALIB, "pred", None, 54.8, 78.5, 90.4, 100.0, 71.4),
    Published(_SN, "camera", hdecomp(DLT), "pred", None, 40.6, 63.2, 80.4, 79.6, 55.9),
    Published(_SN, "camera", hdecomp(CHEN_WIDER), "pred", None, 34.4, 64.6, 81.3, 66.6, 52.0),
    # lower half
    Published(_SN, "homography", TVCALIB, "GT", TAU, 65.0, 85.4, 95.6, 92.8, 75.5),
    Published(_SN, "homography", TVCALIB, "GT", None, 61.7, 81.6, 92.0, 100.0, 73.9),
    Published(_SN, "homography", CHEN_WIDER, "GT", None, 57.3, 76.0, 83.7, 100.0, 68.0),
    Published(_SN, "homography", hdecomp(CHEN_WIDER), "GT", None, 61.1, 81.2, 89.4, 80.3, 67.5),
    Published(_SN, "homography", DLT, "GT", None, 54.7, 69.9, 81.6, 97.6, 64.4),
    Published(_SN, "homography", hdecomp(DLT), "GT", None, 56.5, 74.3, 86.3, 79.8, 63.6),
    Published(_SN, "homography", TVCALIB, "pred", TAU, 54.6, 78.3, 92.4, 93.7, 70.8),
    Published(_SN, "homography", TVCALIB, "pred", None, 51.9, 75.2, 89.4, 100.0, 69.5),
    Published(_SN, "homography", DLT, "pred", None, 46.9, 66.5, 79.3, 97.9, 61.3),
    Published(_SN, "homography", hdecomp(DLT), "pred", None, 46.5, 68.5, 83.0, 79.6, 59.2),
    Published(_SN, "homography", CHEN_WIDER, "pred", None, 32.9, 59.0, 72.5, 100.0, 54.6),
    Published(_SN, "homography", hdecomp(CHEN_WIDER), "pred", None, 40.1, 68.3, 82.3, 66.6, 54.0),
    # table "Evaluating the reprojection error induced by the camera parameters on WC14-test"
    Published(_WC, "camera", TVCALIB, "GT", None, 64.4, 86.7, 96.0, 100.0, 86.4),
    Published(_WC, "camera", hdecomp(CHEN), "GT", None, 52.8, 78.8, 91.3, 90.9, 79.0),
    Published(_WC, "camera", hdecomp(ANNOTATED), "-", None, 48.1, 78.9, 91.5, 90.9, 78.4),
    Published(_WC, "camera", hdecomp(DLT), "GT", None, 32.0, 54.0, 73.1, 73.7, 57.1),
    Published(_WC, "camera", TVCALIB, "pred", None, 39.9, 71.9, 90.5, 100.0, 75.0),
    Published(_WC, "camera", hdecomp(CHEN) + FAR, "-", None, 29.0, 59.8, 79.0, 100.0, 63.6),
    Published(_WC, "camera", hdecomp(JIANG) + FAR, "-", None, 32.4, 58.5, 75.3, 99.5, 61.8),
    Published(_WC, "camera", TVCALIB, "pred", TAU, 41.3, 73.6, 91.4, 95.7, 76.0),
    Published(_WC, "camera", hdecomp(CHEN), "-", None, 32.7, 67.3, 87.3, 81.7, 69.4),
    Published(_WC, "camera", hdecomp(JIANG), "-", None, 36.9, 66.4, 83.9, 84.9, 68.4),
    Published(_WC, "camera", hdecomp(CHEN), "pred", None, 28.1, 60.6, 80.8, 78.5, 63.0),
    Published(_WC, "camera", hdecomp(DLT), "pred", None, 26.9, 53.3, 72.7, 74.2, 56.0),
    # table "Ablation study for radial lens distortion correction": the rows of WC14-test
    Published(_WC, "camera", TVCALIB + LENS, "GT", None, 68.4, 87.3, 95.5, 100.0, float("nan")),
    # table "Evaluating the homography estimation on WC14-test"
    Published(_WC, "homography", hdecomp(CHEN), "GT", None, 56.1, 80.6, 91.1, 90.9, 80.0),
    Published(_WC, "homography", hdecomp(ANNOTATED), "-", None, 50.6, 79.4, 91.1, 90.9, 78.8),
    Published(_WC, "homography", hdecomp(DLT), "GT", None, 35.8, 57.6, 74.2, 73.7, 59.4),
    Published(_WC, "homography", TVCALIB, "GT", None, 62.7, 84.9, 95.5, 100.0, 85.3, (96.1, 97.1)),
    Published(_WC, "homography", ANNOTATED, "-", None, 54.1, 82.9, 92.4, 100.0, 81.8, (100.0, 100.0)),
    Published(_WC, "homography", CHEN, "GT", None, 61.2, 82.5, 90.6, 100.0, 81.8, (95.2, 97.3)),
    Published(_WC, "homography", DLT, "GT", None, 39.2, 57.4, 72.1, 89.8, 60.3, (82.6, 96.5)),
    Published(_WC, "homography", TVCALIB, "pred", None, 38.8, 69.1, 89.4, 100.0, 73.3, (95.3, 96.6)),
    Published(_WC, "homography", CHEN, "-", None, 35.8, 66.3, 84.4, 100.0, 69.5, (94.6, 96.3)),
    Published(_WC, "homography", JIANG, "-", None, 36.9, 62.9, 81.5, 100.0, 67.1, (95.2, 97.1)),
    Published(_WC, "homography", CHEN, "pred", None, 28.8, 58.0, 77.3, 100.0, 62.1, (91.7, 94.9)),
    Published(_WC, "homography", DLT, "pred", None, 31.4, 55.9, 71.9, 87.6, 58.4, (83.7, 95.4)),
)

# Not in the paper: PnLCalib's released results. On WC14-test its own solver on its networks' detections in the frames
# with odd ids; on SN-Calib its cameras of the 47 frames whose pictures are available. Scored as SoccerNet does.
RELEASED: tuple[Published, ...] = (
    Published(_WC, "camera", PNLCALIB, "PnLCalib", None, 73.9, 91.1, 94.5, float("nan"), float("nan")),
    Published(
        "SN-Calib-test-center, pictures", "camera", PNLCALIB, "images", None, 79.3, 92.6, 95.4, 97.9, float("nan")
    ),
)

# Table "Dataset comparison": images, resolution, shares of the cameras (main center, left, right, other) in percent.
DATASETS: dict[str, tuple[int, str, tuple[float, float, float, float]]] = {
    "SN-Calib-train": (14513, "540p", (48.0, 14.0, 15.0, 23.0)),
    "SN-Calib-valid": (2796, "540p", (52.7, 10.2, 9.5, 27.7)),
    "SN-Calib-test": (2719, "540p", (53.5, 8.5, 9.5, 28.5)),
    "WC14-train/valid": (209, "720p", (100.0, 0.0, 0.0, 0.0)),
    "WC14-test": (186, "720p", (100.0, 0.0, 0.0, 0.0)),
}
