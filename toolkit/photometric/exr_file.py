"""A relightable texture as one EXR with named channels."""

from __future__ import annotations

import json
import os

import numpy as np

from intaglio.errors import FileError, InputError
from intaglio.images import read_exr, write_exr
from intaglio.photometric.bases import Basis, HemisphericalBasis, LambertBasis, PolynomialBasis, ThreeImageBasis
from intaglio.photometric.interpolation import GridBasis, RadialBasis, TriangleBasis
from intaglio.photometric.relightable import Relightable

Array = np.ndarray

ATTRIBUTE = "intaglioRelightable"
_BASES: dict[str, type] = {
    "lambert": LambertBasis,
    "three-images": ThreeImageBasis,
    "polynomial": PolynomialBasis,
    "hemispherical": HemisphericalBasis,
    "grid": GridBasis,
    "triangles": TriangleBasis,
    "radial": RadialBasis,
}


def write_relightable_exr(texture: Relightable, path: str | os.PathLike[str]) -> None:
    """Write all of a texture: channels ``map00.R``, …, and what its basis needs in the header, as JSON.

    Channels are 32-bit floats and the basis' numbers are written in full, so that `read_relightable_exr` gives the same bits.
    """
    letters = "RGB" if texture.maps.shape[3] == 3 else "Y"
    channels = {f"map{j:02d}.{c}": texture.maps[j, :, :, i] for j in range(len(texture.maps)) for i, c in enumerate(letters)}
    if texture.chroma is not None:
        channels |= {f"chroma.{c}": texture.chroma[:, :, i] for i, c in enumerate("RGB")}
    for name in ("mask", "height", "confidence"):
        plane = getattr(texture, name)
        if plane is not None:
            channels[f"{name}.Y"] = plane.astype(np.float32)
    described = {"version": 1, "kind": texture.kind, "basis": texture.basis.parameters(), "notes": list(texture.notes)}
    write_exr(channels, path, metadata={ATTRIBUTE: json.dumps(described)})


def read_relightable_exr(path: str | os.PathLike[str]) -> Relightable:
    """Read what `write_relightable_exr` wrote.

    Raises
    ------
    FileError
        If the file is no EXR, or no relightable texture.
    """
    channels, header = read_exr(path)
    try:
        described = json.loads(str(header[ATTRIBUTE]))
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
    except (KeyError, TypeError, ValueError, InputError) as error:
        raise FileError(f"{path}: is an EXR, but no relightable texture ({error})") from error


def basis_from_parameters(parameters: dict[str, object]) -> Basis:
    """Return the basis that `Basis.parameters` described.

    Raises
    ------
    InputError
        If the name is unknown or something is missing.
    """
    given = {k: np.asarray(v) if isinstance(v, list) else v for k, v in parameters.items()}
    name = str(given.pop("basis", None))
    if name not in _BASES:
        raise InputError(f"basis {name!r} is not known; known: {', '.join(_BASES)}")
    try:
        basis: Basis = _BASES[name](**given)
    except TypeError as error:
        raise InputError(f"basis {name!r} lacks or has too many parameters ({error})") from error
    return basis
