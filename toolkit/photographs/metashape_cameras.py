"""Reading the cameras that Agisoft Metashape exports as XML: axes as here, principal points from the picture's middle."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import FileError, InputError
from intaglio.photographs.camera_parts import View, Views, intrinsic, number, numbers, pixels, pose, read_text, short

_OFF = ("0", "false")

# What a calibration may hold besides the coefficients that are understood.
_UNUSED = ("resolution", "date", "width", "height", "projection", "sensor")


def xml_root(path: Path) -> ElementTree.Element:
    """Return the root of an XML file, or raise `FileError`."""
    text = read_text(path)
    if "<!ENTITY" in text:
        raise FileError(f"{path}: defines entities, which no camera file needs")
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, RecursionError) as problem:
        raise FileError(f"{path}: is not XML ({short(problem)})") from problem


def metashape_views(path: Path) -> Views:
    """Read the enabled cameras that are aligned."""
    root = xml_root(path)
    chunks = [root] if root.tag == "chunk" else root.findall("chunk")
    if not chunks:
        raise FileError(f"{path}: has no chunk, as the cameras that Metashape exports as XML have")
    found = Views()
    if len(chunks) > 1:
        found.notes.append(f"has {len(chunks)} chunks; the first is read")
    chunk = chunks[0]
    try:
        sensors = {s.get("id"): s for s in chunk.iterfind("sensors/sensor")}
        places = {c.get("id"): _similarity(c.find("transform")) for c in chunk.iterfind("components/component")}
        whole = _similarity(chunk.find("transform"))
    except InputError as problem:
        raise InputError(f"{path}: {problem}") from problem
    cameras = [c for c in chunk.iterfind("cameras//camera") if c.get("enabled", "true").lower() not in _OFF]
    # A rig's other cameras have the master's pose; each has a picture of its own.
    aligned = [c for c in cameras if c.find("transform") is not None]
    if cameras and not aligned:
        raise InputError(f"{path}: none of its {len(cameras)} cameras is aligned")
    for camera in aligned:
        name = camera.get("label") or ""
        try:
            if not name:
                raise InputError("has no label")
            if camera.get("sensor_id") not in sensors:
                raise InputError(f"its sensor {short(camera.get('sensor_id'))} is not among the sensors")
            values = _calibration(sensors[camera.get("sensor_id")])
            to_world = numbers(camera.findtext("transform"), 16, "its transform").reshape(4, 4)
            scale, turn, shift = places.get(camera.get("component_id")) or whole or (1.0, np.eye(3), np.zeros(3))
            center = scale * turn @ to_world[:3, 3] + shift
            found.views.append(View(name, {**values, **pose(center, (turn @ to_world[:3, :3]).T)}))
        except InputError as problem:
            raise InputError(f"{path}: camera {short(name) or short(camera.get('id'))}: {problem}") from problem
        # Positions on the globe are counted from its centre.
        if np.linalg.norm(center) > 1e6 and not found.notes:
            found.notes.append(
                "its coordinates are geocentric; the mesh must be in them, too (or export both in local coordinates)"
            )
    return found


def _similarity(element: ElementTree.Element | None) -> tuple[float, Array, Array] | None:
    """Return scale, rotation and translation from a chunk's or component's own coordinates to the exported ones."""
    if element is None:
        return None
    if element.find("rotation") is None:
        if not (element.text or "").strip():
            return None
        whole = numbers(element.text, 16, "the chunk's transform").reshape(4, 4)
        scale = float(np.cbrt(np.linalg.det(whole[:3, :3])))
        if not scale > 0:
            raise InputError("the chunk's transform is no similarity")
        return scale, whole[:3, :3] / scale, whole[:3, 3]
    turn = numbers(element.findtext("rotation"), 9, "the chunk's rotation").reshape(3, 3)
    shift = numbers(element.findtext("translation") or "0 0 0", 3, "the chunk's translation")
    scale = number(element.findtext("scale") or 1.0, "the chunk's scale")
    if scale <= 0:
        raise InputError(f"the chunk's scale must be above 0, not {scale:g}")
    return scale, turn, shift


def _calibration(sensor: ElementTree.Element) -> dict[str, Any]:
    """Return the arguments of a Camera for a sensor; Metashape's manual has the formulas in its appendix on camera models."""
    calibrations = sensor.findall("calibration")
    if not calibrations:
        raise InputError(f"its sensor {short(sensor.get('label'))} has no calibration")
    best = next((c for c in calibrations if c.get("class") == "adjusted"), calibrations[0])
    kind = best.get("type") or sensor.get("type") or "frame"
    if kind not in ("frame", "fisheye"):
        raise InputError(f"its sensor is of the type {short(kind)}; known: frame, fisheye. Export undistorted images")
    size = best.find("resolution") if best.find("resolution") is not None else sensor.find("resolution")
    if size is None:
        raise InputError("its sensor has no resolution")
    height, width = pixels(size.get("height"), "its height"), pixels(size.get("width"), "its width")
    given = {c.tag: number(c.text, f"{short(c.tag)} of its calibration") for c in best if c.tag not in _UNUSED}
    known = {"f", "fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4", "p1", "p2", "b1", "b2", "skew"}
    strange = [key for key, value in given.items() if key not in known and value]
    if strange:
        raise InputError(
            f"its calibration has {short(strange[0])}, which is not read; fit without it or export undistorted images"
        )
    k1, k2, k3, k4, p1, p2 = (given.get(key, 0.0) for key in ("k1", "k2", "k3", "k4", "p1", "p2"))
    cx, cy = given.get("cx", 0.0), given.get("cy", 0.0)
    if "fx" in given:
        # Before version 1.2: two focal lengths, the principal point from the corner, tangential terms as OpenCV's.
        k = intrinsic(given["fx"], given.get("fy", given["fx"]), cx - 0.5, cy - 0.5, given.get("skew", 0.0))
    elif "f" in given:
        f, b1, b2 = given["f"], given.get("b1", 0.0), given.get("b2", 0.0)
        k = intrinsic(f + b1, f, width / 2 + cx - 0.5, height / 2 + cy - 0.5, b2)
        p1, p2 = p2, p1
    else:
        raise InputError("its calibration has no focal length (f)")
    model = "fisheye" if kind == "fisheye" else "brown"
    return {"K": k, "size": (height, width), "distortion": [k1, k2, k3, k4, p1, p2], "model": model}
