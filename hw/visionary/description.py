"""The XML of a frame: what its maps are, and the camera's geometry. No I/O.

Source: visionary sheet, section 5.
"""

import math
from xml.etree import ElementTree

from msgspec import Struct

from hw.visionary.blob import MOST_XML

T_MINI, T_MINI_UNIT_MM = "Visionary-T Mini", 0.25  # its decimalexponent does not say so
WITH_STATES = (T_MINI, "Visionary-S")  # their third map is 0 where a pixel is good
SIZES = {"uint8": 1, "uint16": 2, "uint32": 4, "uint64": 8, "float32": 4}
SETS = ("DataSetDepthMap", "DataSetStereo")
STREAM = "FormatDescriptionDepthMap/DataStream"
REFUSED = (b"<!DOCTYPE", b"<!ENTITY", b"\0")  # entities grow; nor any text but of single bytes
MOST_SIDE = 2048  # pixels
MATRIX = ("CameraMatrix/FX", "CameraMatrix/FY", "CameraMatrix/CX", "CameraMatrix/CY")
DISTORTION = ("CameraDistortionParams/K1", "CameraDistortionParams/K2")
UNITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
ROTATION_TOLERANCE = 1e-3
LEAST_FIELD, MOST_FIELD = math.radians(10.0), math.radians(150.0)
MOST_AWAY_MM = 2000.0  # of the camera's own origin from its lens


class Description(Struct, frozen=True):
    """What holds for all frames of one change counter."""

    model: str
    width: int
    height: int
    focal_px: tuple[float, float]  # as told, with their signs
    centre_px: tuple[float, float]
    distortion: tuple[float, float]  # K1, K2
    away_mm: tuple[float, float, float]  # of the lens, in the camera's axes
    is_planar: bool  # depth along the axis; else along each ray
    unit_mm: float
    third_at: int  # bytes before the map of states or confidences, behind the fields; -1: none
    third_size: int  # of its numbers: 1 or 2 bytes
    has_states: bool  # it is 0 where a pixel is good; else the higher the better
    maps_size: int  # bytes of all


class DescriptionError(Exception):
    """Why an XML is of no use."""


def description_of(xml: bytes) -> Description | str:
    """What it says; or why it is of no use, in words."""
    if len(xml) > MOST_XML or any(mark in xml for mark in REFUSED):
        return "a description that is too long, or has a DOCTYPE"
    try:
        record = ElementTree.fromstring(xml)
    except (ElementTree.ParseError, ValueError, LookupError):
        return "a description that is no XML"
    sets = [part for name in SETS for part in record.findall(f"DataSets/{name}")]
    found = sets[0] if sets else None
    stream = None if found is None else found.find(STREAM)
    if found is None or stream is None:
        return "a description without a depth map: is it switched on in the camera?"
    try:
        return _described((found.findtext("DeviceDescription/Ident") or "")[:200], stream)
    except DescriptionError as error:
        return f"the camera's description has {error}"


def _described(model: str, stream: ElementTree.Element) -> Description:
    width, height = (_number(stream, name) for name in ("Width", "Height"))
    if not (width.is_integer() and height.is_integer()):
        raise DescriptionError(f"{width:g} x {height:g} px")
    if not (2 <= width <= MOST_SIDE and 2 <= height <= MOST_SIDE):
        raise DescriptionError(f"{width:g} x {height:g} px, allowed are 2 .. {MOST_SIDE}")
    pixels = int(width * height)
    is_planar = stream.find("Z") is not None
    depth = stream.find("Z" if is_planar else "Distance")
    if depth is None or _size(depth) != 2:
        raise DescriptionError("no depths of uint16")
    colour, third = stream.find("Intensity"), stream.find("Confidence")
    between = 2 + (_size(colour) if colour is not None else 0)
    third_size = _size(third) if third is not None else 0
    if third_size > 2:
        raise DescriptionError("a map of states that is neither uint8 nor uint16")
    fx, fy, cx, cy = (_number(stream, name) for name in MATRIX)
    _check_field(width, fx, cx, "X")
    _check_field(height, fy, cy, "Y")
    k1, k2 = (_number(stream, name) for name in DISTORTION)
    return Description(
        model,
        int(width),
        int(height),
        (fx, fy),
        (cx, cy),
        (k1, k2),
        _away_mm(stream),
        is_planar,
        T_MINI_UNIT_MM if T_MINI in model else _unit_mm(depth),
        between * pixels if third is not None else -1,
        third_size,
        any(name in model for name in WITH_STATES),
        (between + third_size) * pixels,
    )


def _number(stream: ElementTree.Element, path: str) -> float:
    text = stream.findtext(path) or ""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) < 1e9:
        raise DescriptionError(f"{path} = {text[:20]!r}")
    return value


def _size(node: ElementTree.Element) -> int:
    """Bytes of a map's number."""
    kind = (node.text or "").strip().lower()
    if kind not in SIZES:
        raise DescriptionError(f"{node.tag} of type {kind[:20]!r}")
    return SIZES[kind]


def _unit_mm(depth: ElementTree.Element) -> float:
    text = depth.get("decimalexponent", "0")
    if text.strip() not in [str(exponent) for exponent in range(-4, 3)]:
        raise DescriptionError(f"decimalexponent = {text[:20]!r}")
    return float(10.0 ** int(text))


def _check_field(size: float, focal: float, centre: float, axis: str) -> None:
    """Whether such a lens can be: what it sees, and where its middle is."""
    sees = 2.0 * math.atan2(size / 2.0, abs(focal))
    if not (LEAST_FIELD <= sees <= MOST_FIELD and 0.0 <= centre <= size):
        raise DescriptionError(
            f"a camera matrix that can't be: F{axis} {focal:g}, C{axis} {centre:g}"
        )


def _away_mm(stream: ElementTree.Element) -> tuple[float, float, float]:
    """Where the lens is: of the matrix and what stands before its axis."""
    values = [node.text or "" for node in stream.findall("CameraToWorldTransform/value")]
    try:
        numbers = [float(text) for text in values]
    except ValueError:
        numbers = []
    if len(numbers) != 16 or not all(math.isfinite(number) for number in numbers):
        raise DescriptionError("no matrix from camera to world")
    turn = (*numbers[0:3], *numbers[4:7], *numbers[8:11])
    if max(abs(a - b) for a, b in zip(turn, UNITY, strict=True)) > ROTATION_TOLERANCE:
        raise DescriptionError(
            "a mounting of its own that turns it: reset it there, mapod's settings have it"
        )
    cross = _number(stream, "FocalToRayCross") if stream.find("FocalToRayCross") is not None else 0
    x, y, z = numbers[3], numbers[7], numbers[11] - cross
    if max(abs(x), abs(y), abs(z)) > MOST_AWAY_MM:
        raise DescriptionError(f"a lens that is {x:g}, {y:g}, {z:g} mm away")
    return x, y, z
