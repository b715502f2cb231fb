"""CVAT's XML, "CVAT for images 1.1": polylines, polygons and points of many images in one file.

Its coordinates count from the corner of the image: the centre of the first pixel is at (0.5, 0.5).
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import Any
from xml.etree import ElementTree  # to write; what others wrote is read through defusedxml

from fieldcalib._extras import imported
from fieldcalib.io.annotations import Annotation, Shapes, annotation_of, exported
from fieldcalib.io.files import BrokenFileError

READ = ("polyline", "polygon", "points")
LEFT_OUT = ("box", "ellipse", "cuboid", "mask")


def parse_cvat(content: bytes | str) -> list[Annotation]:
    """The annotations of all images of a file.

    Points of a skeleton have labels of their own. Boxes, ellipses, cuboids and masks are left out.

    Raises
    ------
    BrokenFileError
        If it is no XML, has a document type (entities of which may grow without end), or no images. What is wrong with
        one image is in its annotation.
    ImportError
        Without defusedxml.
    """
    root = _root(content)
    if root.tag != "annotations":
        raise BrokenFileError(f"expected the <annotations> of CVAT, got <{root.tag}>")
    if root.find("track") is not None:
        raise BrokenFileError("holds the tracks of a video: export it from CVAT as 'CVAT for images 1.1'")
    images = root.findall("image")
    if not images:
        raise BrokenFileError("holds no <image>: export it from CVAT as 'CVAT for images 1.1'")
    return [
        annotation_of(image.get("name"), partial(_shapes, image), f"image {number}")
        for number, image in enumerate(images, 1)
    ]


def _root(content: bytes | str) -> Any:
    parser = imported("defusedxml.ElementTree", "cvat", "the XML of CVAT")
    try:
        return parser.fromstring(content, forbid_dtd=True)
    except (SyntaxError, ValueError, LookupError) as error:  # of the XML, of entities, of an unknown encoding
        unsafe = type(error).__module__.startswith("defusedxml")
        what = "has a document type or entities, which are not read" if unsafe else f"is no XML: {error}"
        raise BrokenFileError(what) from None


def _shapes(image: Any) -> Shapes:
    shapes = Shapes.of(image.get("width"), image.get("height"))
    for shape in image:
        if shape.tag == "skeleton":
            for point in shape.findall("points"):
                if point.get("outside") != "1":
                    shapes.add(point.get("label"), _points(point))
        elif shape.tag in READ:
            shapes.add(shape.get("label"), _points(shape))
        elif shape.tag in LEFT_OUT:
            shapes.leave_out(shape.tag, shape.get("label"))
    return shapes


def _points(shape: Any) -> list[list[str]]:
    return [pair.split(",") for pair in (shape.get("points") or "").split(";")]


def format_cvat(annotations: Iterable[Annotation]) -> str:
    """The XML of annotations: the inverse of `parse_cvat`, polylines and single points.

    Raises
    ------
    ValueError
        As `exported`.

    Examples
    --------
    >>> text = format_cvat([Annotation("1", {"Middle line": [(10.0, 20.0), (10.5, 40.0)]}, (96, 54), "1.jpg")])
    >>> print(text.splitlines()[-3])
        <polyline label="Middle line" source="auto" occluded="0" points="10.5,20.5;11.0,40.5" z_order="0" />
    """
    made = [exported(annotation) for annotation in annotations]
    root = ElementTree.Element("annotations")
    ElementTree.SubElement(root, "version").text = "1.1"
    task = ElementTree.SubElement(ElementTree.SubElement(root, "meta"), "task")
    ElementTree.SubElement(task, "size").text = str(len(made))
    ElementTree.SubElement(task, "mode").text = "annotation"
    labels = ElementTree.SubElement(task, "labels")
    for name in dict.fromkeys(label for _, _, shapes in made for label, _ in shapes):
        label = ElementTree.SubElement(labels, "label")
        ElementTree.SubElement(label, "name").text = name
        ElementTree.SubElement(label, "attributes")
    for number, (file, (w, h), shapes) in enumerate(made):
        image = ElementTree.SubElement(root, "image", id=str(number), name=file, width=str(w), height=str(h))
        for name, points in shapes:
            ElementTree.SubElement(
                image,
                "polyline" if len(points) > 1 else "points",
                label=name,
                source="auto",
                occluded="0",
                points=";".join(f"{x!r},{y!r}" for x, y in points),
                z_order="0",
            )
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"
