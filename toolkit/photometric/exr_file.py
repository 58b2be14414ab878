"""Reading and writing a relightable texture as one EXR with named channels."""

from __future__ import annotations

import json

import numpy as np

from intaglio.arrays import PathLike
from intaglio.errors import FileError, InputError
from intaglio.files import read_exr, write_exr
from intaglio.photometric.bases import (
    Basis,
    HemisphericalBasis,
    LambertBasis,
    PolynomialBasis,
    ThreeImageBasis,
    coefficients,
)
from intaglio.photometric.interpolation import CHARTS, KERNELS, TRENDS, GridBasis, RadialBasis, TriangleBasis
from intaglio.photometric.relightable import LARGEST, Relightable

ATTRIBUTE = "intaglioRelightable"
VERSION = 1
_BASES: dict[str, type] = {
    "lambert": LambertBasis,
    "three-images": ThreeImageBasis,
    "polynomial": PolynomialBasis,
    "hemispherical": HemisphericalBasis,
    "grid": GridBasis,
    "triangles": TriangleBasis,
    "radial": RadialBasis,
}


def write_relightable_exr(texture: Relightable, path: PathLike) -> None:
    """Write everything of a texture: channels ``map00.R`` and so on, and the parameters of its basis in the header, as JSON.

    Channels are 32-bit floats and the basis' numbers are written with all digits, so that `read_relightable_exr` gives the same
    bits.
    """
    letters = "RGB" if texture.maps.shape[3] == 3 else "Y"
    channels = {f"map{j:02d}.{c}": texture.maps[j, :, :, i] for j in range(len(texture.maps)) for i, c in enumerate(letters)}
    if texture.chroma is not None:
        channels |= {f"chroma.{c}": texture.chroma[:, :, i] for i, c in enumerate("RGB")}
    for name in ("mask", "height", "confidence"):
        plane = getattr(texture, name)
        if plane is not None:
            channels[f"{name}.Y"] = plane.astype(np.float32)
    described = {"version": VERSION, "kind": texture.kind, "basis": texture.basis.parameters(), "notes": list(texture.notes)}
    write_exr(channels, path, metadata={ATTRIBUTE: json.dumps(described)})


def read_relightable_exr(path: PathLike) -> Relightable:
    """Read a texture that `write_relightable_exr` wrote.

    Raises
    ------
    FileError
        If the file is not an EXR, or not a relightable texture.
    """
    channels, header = read_exr(path)
    try:
        described = json.loads(str(header[ATTRIBUTE]))
        if described["version"] != VERSION:
            raise InputError(f"it is of version {described['version']}, this program reads version {VERSION}")
        letters = "RGB" if "map00.R" in channels else "Y"
        count = sum(name.startswith("map") and name.endswith("." + letters[0]) for name in channels)
        maps = np.stack([np.stack([channels[f"map{j:02d}.{c}"] for c in letters], axis=-1) for j in range(count)])
        chroma = np.stack([channels[f"chroma.{c}"] for c in "RGB"], axis=-1) if "chroma.R" in channels else None
        mask = channels["mask.Y"] > 0.5 if "mask.Y" in channels else None
        return Relightable(
            described["kind"],
            maps,
            basis_from_parameters(described["basis"]),
            chroma,
            mask,
            channels.get("height.Y"),
            channels.get("confidence.Y"),
            tuple(described["notes"]),
        )
    except (KeyError, IndexError, TypeError, ValueError, OverflowError, AttributeError, RecursionError, InputError) as error:
        # LinAlgError is a ValueError.
        raise FileError(f"{path}: is an EXR, but not a relightable texture ({error})") from error


def basis_from_parameters(parameters: dict[str, object]) -> Basis:
    """Return the basis that `Basis.parameters` described.

    Raises
    ------
    InputError
        If the name is unknown, a parameter is missing or has another shape, or coefficients are not finite.
    """
    if not isinstance(parameters, dict):
        raise InputError("its basis is not a set of parameters")
    given = {k: np.asarray(v) if isinstance(v, list) else v for k, v in parameters.items()}
    name = str(given.pop("basis", None))
    if name not in _BASES:
        raise InputError(f"basis {name!r} is not known; known: {', '.join(_BASES)}")
    for key, value in given.items():
        if isinstance(value, np.ndarray) and not (value.dtype.kind in "if" and value.size and np.isfinite(value).all()):
            raise InputError(f"{key} of basis {name!r} is not an array of finite numbers")
    try:
        basis: Basis = _BASES[name](**given)
    except TypeError as error:
        raise InputError(f"basis {name!r} has too few or too many parameters ({error})") from error
    _check(basis)
    lights = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [-0.48, 0.64, 0.6], [0.0, -0.96, 0.28]])
    with np.errstate(all="ignore"):
        found = coefficients(basis, lights)
    if not (np.abs(found) <= LARGEST).all():
        raise InputError(f"basis {name!r} gives coefficients that are not finite, or over {LARGEST:g}")
    return basis


def _check(basis: Basis) -> None:
    """Raise `InputError` if the shapes of a basis' arrays don't fit each other, or a name is unknown."""
    fits = True
    if isinstance(basis, ThreeImageBasis):
        fits = basis.lights.shape == (3, 3)
    elif isinstance(basis, HemisphericalBasis):
        fits = basis.order in (2, 3)
    elif isinstance(basis, GridBasis):
        rising = (np.diff(basis.tilts) > 0).all() and (np.diff(basis.slants) > 0).all() and np.ptp(basis.tilts) < 360
        fits = basis.table.ndim == 3 and basis.table.shape[:2] == (len(basis.tilts), len(basis.slants)) and bool(rising)
    elif isinstance(basis, TriangleBasis):
        count = len(basis.nodes)
        corners = basis.triangles
        fits = basis.nodes.shape == (count, 3) and basis.table.ndim == 2 and len(basis.table) == count
        fits = fits and corners.ndim == 2 and corners.shape[1] == 3 and corners.dtype.kind == "i"
        fits = fits and corners.min() >= 0 and corners.max() < count
    elif isinstance(basis, RadialBasis):
        count = len(basis.lights)
        known = basis.chart in CHARTS and basis.kernel in KERNELS and basis.trend in TRENDS
        fits = known and basis.lights.shape == (count, 3) and basis.weights.ndim == 2 and len(basis.weights) == count
        functions = 3 if basis.trend == "chart" and basis.chart != "chord" else 4
        fits = fits and basis.drift.shape == (functions, basis.weights.shape[1])
    if not fits:
        raise InputError(f"the parameters of its basis ({type(basis).__name__}) don't fit each other")
