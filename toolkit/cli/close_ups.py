"""Where `render` looks: at all of a mesh, at a point of it, or at one of its holes or fillings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.mesh import Surface, adjacency, pieces
from intaglio.relief import list_holes
from intaglio.render import Viewpoint, frame

# A hole and so much around it, in its radii, fills the picture.
_AROUND = 1.8
# So many times the mesh's size off its middle there is nothing to look at.
_FAR = 10.0


@dataclass(frozen=True)
class CloseUp:
    """What the options of `render` say about where it looks.

    Attributes
    ----------
    direction, up : tuple of float
        From the object to the eye, None for the default; and what is upright in the picture.
    look_at : tuple of float or None
        Point that is in the middle of the picture; None for the mesh's own.
    zoom : float or None
        How much larger it is shown than where the whole mesh fills the picture.
    hole : int or None
        Number of a hole, or of a filling.
    """

    direction: tuple[float, ...] | None
    up: tuple[float, ...]
    look_at: tuple[float, ...] | None
    zoom: float | None
    hole: int | None

    def __post_init__(self) -> None:
        if self.look_at is not None and self.hole is not None:
            raise InputError("--look-at and --hole both say where to look; give one of them")
        if self.zoom is not None and not np.isfinite(self.zoom):
            raise InputError(f"--zoom must be a finite number, not {self.zoom}")
        if not any(self.up) or (self.direction is not None and not any(self.direction)):
            raise InputError("--direction and --up must not be all zero")

    def camera(self, mesh: Path, surface: Surface) -> Viewpoint:
        """Return the camera that sees it.

        Raises
        ------
        InputError
            If there is no such hole, or nothing to see.
        """
        used = np.unique(surface.faces)
        if len(used) == 0:
            raise InputError(f"{mesh}: has no faces, there is nothing to render")
        direction = _of_usual_length((0.0, 0.0, 1.0) if self.direction is None else self.direction)
        target, zoom = self.look_at, self.zoom
        if self.hole is not None:
            rim = _around_hole(mesh, surface, self.hole)
            middle = surface.vertices[rim].mean(axis=0)
            target = tuple(middle.tolist())
            outward = surface.normal[rim].sum(axis=0)
            if self.direction is None and outward.any():
                direction = outward
            radius = float(np.linalg.norm(surface.vertices[rim] - middle, axis=1).max())
            points = surface.vertices[used]
            whole = float(np.linalg.norm(points - (points.min(axis=0) + points.max(axis=0)) / 2, axis=1).max())
            zoom = max(whole / (_AROUND * max(radius, 1e-300)), 1.0) * (1.0 if zoom is None else zoom)
        try:
            camera = frame(surface.vertices[used], direction, up=_of_usual_length(self.up), margin=1.05)
        except ValueError as error:
            raise InputError(f"{mesh}: {error}") from error
        if target is not None:
            low, high = surface.vertices[used].min(axis=0), surface.vertices[used].max(axis=0)
            if not (np.abs(np.subtract(target, (low + high) / 2)) <= _FAR * np.linalg.norm(high - low)).all():
                bounds = " to ".join(",".join(f"{v:.6g}" for v in end) for end in (low, high))
                raise InputError(f"--look-at {','.join(f'{v:g}' for v in target)} is far off {mesh}, which reaches from {bounds}")
            shift = np.subtract(target, camera.target)
            camera = replace(camera, origin=_moved(camera.origin, shift), target=_moved(camera.target, shift))
        if zoom is not None:
            # A longer lens from the same place: nothing comes between that was behind the eye.
            camera = replace(camera, fov=float(np.degrees(2 * np.arctan(np.tan(np.radians(camera.fov) / 2) / zoom))))
        return camera


def _of_usual_length(vector: tuple[float, ...]) -> Array:
    """Return a vector of any length but zero, whose square may not be a number, as one of about 1."""
    return np.asarray(np.array(vector) / np.abs(vector).max())


def _moved(point: tuple[float, float, float], shift: Array) -> tuple[float, float, float]:
    x, y, z = np.add(point, shift).tolist()
    return x, y, z


def _around_hole(mesh: Path, surface: Surface, number: int) -> Array:
    """Return the vertices of a filling, largest first, or of the rim of a hole as `list_holes` numbers them."""
    filled = ~surface.measured
    if filled.any():
        inner = surface.faces[filled[surface.faces].all(axis=1)]
        label = pieces(inner, len(filled))[1]
        found = [np.flatnonzero(filled & (label == k)) for k in np.unique(label[filled])]
        found.sort(key=lambda region: (-len(region), region[0]))
        what = "filling"
    else:
        found = [hole.loop for hole in list_holes(surface)]
        what = "hole"
    if not 1 <= number <= len(found):
        there = f"it has {len(found)} (1 to {len(found)})" if found else "it has none"
        raise InputError(f"{mesh}: there is no {what} {number}: {there}")
    region = found[number - 1]
    if what == "filling":
        rows = adjacency(surface.faces, len(filled))[region]
        region = np.union1d(region, rows.indices)
    return np.asarray(region)
