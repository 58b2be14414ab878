"""What a mesh file holds, before it is mended to a surface: triangles, colours, texture coordinates and pictures."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import FileError, InputError, IntaglioError
from intaglio.files import check_readable, read_samples
from intaglio.kernels.transfer import decode_srgb


@dataclass(frozen=True, kw_only=True)
class RawMesh:
    """Content of a mesh file.

    Attributes
    ----------
    vertices : (N, 3) float64 array
        Positions, numbered as in the file.
    faces : (F, 3) int32 or int64 array
        Triangles; polygons have been cut.
    normals : (N, 3) float64 array or None
        Normals of the vertices, of any length.
    color : (N, 3) float32 array or None
        Linear colours; NaN where a vertex has none of its own.
    uv : (F, 3, 2) float64 array or None
        Texture coordinates of the corners, v upwards; NaN where a face has none.
    pictures : tuple of path or bytes
        Image files that ``uv`` refers to: where they lie, or what they hold.
    picture : (F,) int array or None
        Number of every face's picture, -1 for none. None: the first for all.
    notes : tuple of str
        What of the file was left out or chosen.
    """

    vertices: Array
    faces: Array
    normals: Array | None = None
    color: Array | None = None
    uv: Array | None = None
    pictures: tuple[Path | bytes, ...] = ()
    picture: Array | None = None
    notes: tuple[str, ...] = ()

    def joined_color(self) -> Array | None:
        """Return the colours (N, 3), linear, of the vertices: their own, else the pictures' where they lie in them, else 0."""
        bare = np.ones(len(self.vertices), bool) if self.color is None else np.isnan(self.color).any(axis=1)
        if not bare.any():
            return self.color
        if self.uv is None or not self.pictures:
            return None if self.color is None else np.where(bare[:, None], np.float32(0), self.color)
        color = np.zeros((len(self.vertices), 3), np.float32)
        for number, picture in enumerate(self.pictures):
            own = np.ones(len(self.faces), bool) if self.picture is None else self.picture == number
            own &= np.isfinite(self.uv).all(axis=(1, 2))
            if own.any():
                image = samples_of(picture)
                # Of a vertex's places on several charts the first is taken, which the last of the reversed writes is.
                corner, at = self.faces[own].reshape(-1)[::-1], self.uv[own].reshape(-1, 2)[::-1]
                color[corner] = _nearest(image, at)
        return color if self.color is None else np.where(bare[:, None], color, self.color)

    def split_at_seams(self) -> tuple[Array, Array, Array]:
        """Return the mesh with one place in the texture per vertex, for what knows no others.

        Returns
        -------
        vertex : (M,) int array
            The file's vertex that every vertex is.
        faces : (F', 3) int64 array
            The faces that have texture coordinates, over these.
        uv : (M, 2) float64 array
            Texture coordinates, v upwards.

        Raises
        ------
        InputError
            If no face has texture coordinates.
        """
        whole = np.zeros(len(self.faces), bool) if self.uv is None else np.isfinite(self.uv).all(axis=(1, 2))
        if self.uv is None or not whole.any():
            raise InputError("has no faces with texture coordinates; lay the mesh flat first (intaglio.parameterize)")
        corners = self.faces[whole].reshape(-1)
        # Zero is added to make one of the two zeros.
        places = self.uv[whole].reshape(-1, 2) + 0.0
        order = np.lexsort((places[:, 1], places[:, 0], corners))
        new = np.ones(len(order), bool)
        new[1:] = (corners[order[1:]] != corners[order[:-1]]) | (places[order[1:]] != places[order[:-1]]).any(axis=1)
        number = np.empty(len(order), np.int64)
        number[order] = np.cumsum(new) - 1
        return corners[order[new]], number.reshape(-1, 3), places[order[new]]

    def kept_pictures(self) -> tuple[bytes, ...]:
        """Return the image files that texture coordinates refer to; none if there are no coordinates."""
        if self.uv is None:
            return ()
        return tuple(p if isinstance(p, bytes) else check_readable(p).read_bytes() for p in self.pictures)

    def kept_numbers(self) -> Array | None:
        """Return the number of every face's picture (F,), -1 for none; None where all have the first."""
        if self.uv is None or self.picture is None or not self.pictures:
            return None
        placed = np.isfinite(self.uv).all(axis=(1, 2))
        known = (self.picture >= 0) & (self.picture < len(self.pictures))
        numbers = np.where(placed & known, self.picture, -1).astype(np.int32)
        return None if (numbers[placed] == 0).all() else numbers


def samples_of(picture: Path | bytes) -> Array:
    """Return the samples (H, W, C) of an image file or of its content."""
    image = image_from_bytes(picture) if isinstance(picture, bytes) else read_samples(picture)
    return image[:, :, None] if image.ndim == 2 else image


def image_from_bytes(content: bytes) -> Array:
    """Return the samples of an image file's content; errors and warnings call it "its picture"."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        path = Path(folder, "picture")
        path.write_bytes(content)
        try:
            samples = read_samples(path)
        except IntaglioError as error:
            raise FileError(str(error).replace(str(path), "its picture")) from error
    for warning in caught:
        warnings.warn(str(warning.message).replace(str(path), "its picture"), warning.category, stacklevel=1)
    return samples


def _nearest(image: Array, uv: Array) -> Array:
    """Return the linear colours (K, 3) of the texels at places (K, 2) of a picture that repeats."""
    height, width = image.shape[:2]
    column = np.clip((uv[:, 0] - np.floor(uv[:, 0])) * width, 0, width - 1).astype(int)
    row = np.clip((1 - (uv[:, 1] - np.floor(uv[:, 1]))) * height, 0, height - 1).astype(int)
    texel = image[row, column]
    texel = np.repeat(texel[:, :1], 3, axis=1) if texel.shape[1] < 3 else texel[:, :3]
    if texel.dtype.kind == "f":
        return np.asarray(texel, np.float32)
    return decode_srgb(texel.astype(np.float32) / np.float32(np.iinfo(texel.dtype).max))
