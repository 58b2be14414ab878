"""The planes of web RTI viewers (relight, OpenLIME): ``info.json`` beside ``plane_0.jpg``, ``plane_1.jpg`` and so on.

A JPEG holds three coefficient planes; a coefficient is (level / 255 − bias) × scale. Types: ``ptm`` with the terms in the order
1, x, y, x², xy, y²; ``hsh``; and ``rbf``, where the coefficients of a plane per light and colour channel are a table that the
viewer interpolates by Gaussians about the lights. Any texture can be written as ``rbf``: the table is filled from its basis
at lights spread over the hemisphere.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.checks import checked_arguments, checked_count
from intaglio.errors import FileError
from intaglio.files import whole_folder
from intaglio.photometric.bases import HemisphericalBasis, PolynomialBasis, coefficients
from intaglio.photometric.light_positions import spread_lights
from intaglio.photometric.ptm_file import color_shares, polynomial_maps
from intaglio.photometric.relightable import Relightable

# The viewer's Gaussian weight is exp(−d² / sigma²); the lights are about as far apart as it is wide.
SIGMA = 0.125
NODES = 420

TILE = 256


@checked_arguments
def write_web_planes(texture: Relightable, path: PathLike, *, tiles: bool = False, quality: int = 95) -> list[Path]:
    """Write a texture for web viewers of RTI files, such as relight and OpenLIME.

    Parameters
    ----------
    texture : Relightable
        A texture of any kind: "ptm" is written as type ptm (colourspace lrgb if it has a chromaticity), "hsh" as hsh, all
        others as rbf, with a table of coefficients over 420 lights.
    path : path
        The .json file, which viewers expect to be called ``info.json``; the planes and, for rbf, ``materials.bin`` are
        written beside it. Files of these names are replaced, all or none.
    tiles : bool, optional
        Write Deep Zoom pyramids (``plane_0.dzi``, ``plane_0_files/``) instead of whole planes, for large textures and the
        viewer's layout "deepzoom". Default False.
    quality : int, optional
        Quality of the JPEG planes from 1 to 95. Default 95.

    Returns
    -------
    list of Path
        The files written, the .json last.

    Raises
    ------
    FileError
        If the suffix is not .json, or the files can't be written; files that existed are then as they were.

    Notes
    -----
    Viewers show the values as they are, so fit to the photographs as stored (``read_stack(path, "linear")``). They light
    hemispherical harmonics no lower than a slant of 61 degrees.

    References
    ----------
    Ponchio, Corsini & Scopigno, "RELIGHT: A Compact and Accurate RTI Representation for the Web", Graphical Models 105, 2019.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import intaglio
    >>> lights = np.array([intaglio.light_direction(tilt, 45) for tilt in (0, 90, 180, 270)])
    >>> images = 0.5 * np.ones((4, 8, 8, 1)) * lights[:, 2, None, None, None]
    >>> texture = intaglio.represent(intaglio.PhotometricStack(images, lights), "gradient", device="cpu")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     paths = intaglio.write_web_planes(texture, f"{folder}/info.json")
    >>> [path.name for path in paths]
    ['materials.bin', 'plane_0.jpg', 'info.json']
    """
    quality = checked_count("quality", quality, 1, 95)
    path = Path(path)
    if path.suffix.lower() != ".json":
        raise FileError(f"{path}: web planes are written as .json; viewers expect the name info.json")
    planes, described, table = _planes(texture)
    low, high = planes.min(axis=(1, 2)), planes.max(axis=(1, 2))
    if described["colorspace"] == "lrgb":
        low[:3], high[:3] = 0, 1  # viewers take the colours as they are
    scale = np.where(high > low, high - low, 1.0)
    info = {
        "width": int(planes.shape[2]),
        "height": int(planes.shape[1]),
        "format": "jpg",
        **described,
        "nplanes": len(planes),
        "materials": [{"scale": [float(s) for s in scale], "bias": [float(b) for b in -low / scale]}],
    }
    levels_of_table = None
    if table is not None:
        spread = np.maximum(np.abs(table).max(axis=(1, 2)), 1e-12)
        # Level 0 of the table is the mean image per light, which is part of the planes here.
        levels = np.round(127 + 127 * table / spread[:, None, None]).astype(np.uint8)
        whole = np.concatenate([np.zeros((1, *table.shape[1:]), np.uint8), levels])
        info["materials"][0]["range"] = [float(127 / s) for s in spread]  # type: ignore[index]
        info["basis"] = whole.ravel().tolist()
        levels_of_table = whole.tobytes()
    with whole_folder(path.parent) as beside:
        for j in range(-(-len(planes) // 3)):
            image = np.zeros((*planes.shape[1:], 3), np.uint8)
            for c, plane in enumerate(planes[3 * j : 3 * j + 3], start=3 * j):
                image[..., c % 3] = np.round(255 * np.clip((plane - low[c]) / scale[c], 0, 1))
            if tiles:
                _write_tiles(image, beside, j, quality)
            else:
                _write_plane(image, beside / f"plane_{j}.jpg", quality)
        if levels_of_table is not None:
            (beside / "materials.bin").write_bytes(levels_of_table)
        (beside / path.name).write_text(json.dumps(info), encoding="utf-8")
        written = sorted(p.relative_to(beside) for p in beside.rglob("*") if p.is_file())
    return [path.parent / p for p in written if p.name != path.name] + [path]


def _planes(texture: Relightable) -> tuple[Array, dict[str, object], Array | None]:
    """Return coefficient planes (N, H, W), what info.json says of them, and for rbf the table (N, nodes, 3)."""
    if isinstance(texture.basis, PolynomialBasis):
        maps = polynomial_maps(texture)[[5, 3, 4, 0, 2, 1]]
        if texture.chroma is not None:
            shares, peak = color_shares(texture.chroma)
            planes = np.concatenate([np.moveaxis(shares, 2, 0), maps[..., 0] * peak])
            return planes, {"type": "ptm", "colorspace": "lrgb"}, None
        return _by_channel(maps), {"type": "ptm", "colorspace": "rgb"}, None
    maps = texture.color_maps()
    if isinstance(texture.basis, HemisphericalBasis):
        return _by_channel(maps), {"type": "hsh", "colorspace": "rgb"}, None
    nodes = spread_lights(NODES, 89.0)
    values = coefficients(texture.basis, nodes)
    channels = maps.shape[3]
    planes = np.moveaxis(maps, 3, 1).reshape(-1, *maps.shape[1:3])
    table = np.zeros((len(planes), NODES, 3))
    for j in range(values.shape[1]):
        for c in range(channels):
            which = slice(None) if channels == 1 else slice(c, c + 1)
            table[j * channels + c, :, which] = values[:, j : j + 1]
    described = {"type": "rbf", "colorspace": "mrgb", "sigma": SIGMA, "lights": [round(float(v), 6) for v in nodes.ravel()]}
    return planes, described, table


def _by_channel(maps: Array) -> Array:
    """Return (3n, H, W): red, green and blue of coefficient 0, then of 1, and so on."""
    three = np.repeat(maps, 3, axis=3) if maps.shape[3] == 1 else maps
    return np.moveaxis(three, 3, 1).reshape(-1, *maps.shape[1:3])


def _write_plane(image: Array, path: Path, quality: int) -> None:
    from PIL import Image

    Image.fromarray(image).save(path, "JPEG", quality=quality, subsampling=0)


def _write_tiles(image: Array, folder: Path, j: int, quality: int) -> None:
    """Write one plane as a Deep Zoom pyramid without overlap: level 0 is one pixel, every level doubles."""
    from PIL import Image

    height, width = image.shape[:2]
    levels = int(np.ceil(np.log2(max(height, width)))) if max(height, width) > 1 else 0
    for level in range(levels + 1):
        step = 2 ** (levels - level)
        size = -(-width // step), -(-height // step)
        small = np.asarray(Image.fromarray(image).resize(size, Image.Resampling.BOX)) if step > 1 else image
        below = folder / f"plane_{j}_files" / str(level)
        below.mkdir(parents=True)
        for y in range(0, size[1], TILE):
            for x in range(0, size[0], TILE):
                _write_plane(small[y : y + TILE, x : x + TILE], below / f"{x // TILE}_{y // TILE}.jpg", quality)
    (folder / f"plane_{j}.dzi").write_text(
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<Image xmlns="http://schemas.microsoft.com/deepzoom/2008" Format="jpg" Overlap="0" TileSize="{TILE}">'
        f'<Size Width="{width}" Height="{height}"/></Image>\n',
        encoding="utf-8",
    )
