"""Results of synthesis: maps, and for every pixel its position in the sample."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from intaglio.arrays import Array
from intaglio.checks import check_fields, checked_arguments, checked_shape
from intaglio.errors import InputError
from intaglio.photometric import Relightable


@dataclass(frozen=True)
class Synthesis:
    """A synthesised texture.

    Attributes
    ----------
    maps : (H, W, n) array
        Copies of the sample's values, of its type: ``maps[y, x] == sample[source[y, x, 0], source[y, x, 1]]``, exactly, where
        nothing was ``moved``. (From the heights of a `Relightable` of kind ``"height"`` the sample's plane of best fit is
        subtracted.)
    source : (H, W, 2) int32 array
        Row and column in the sample of each pixel.
    texture : Relightable, optional
        The result as a relightable texture, if the sample was one.
    tileable : bool
        Whether the result wraps around.
    notes : tuple of str
        What was chosen, in words.
    moved : (H, W, n) float32 array, optional
        What was added to the copies to join pieces; None if all are exact.

    Raises
    ------
    InputError
        If an array is of another type or shape, or ``source`` has negative positions.

    See Also
    --------
    intaglio.quilt, intaglio.grow, intaglio.synthesize : Make one.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> made = intaglio.quilt(np.tile(np.eye(8), (4, 4)), (40, 60), block=12, device="cpu")
    >>> made.maps.shape, made.source.shape, made.texture is None
    ((40, 60, 1), (40, 60, 2), True)
    """

    maps: Array
    source: Array
    texture: Relightable | None = None
    tileable: bool = False
    notes: tuple[str, ...] = ()
    moved: Array | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        if self.maps.ndim != 3:
            raise InputError(f"maps must be (H, W, n), not {self.maps.shape}")
        object.__setattr__(self, "source", checked_shape("source", self.source, np.int32, (*self.maps.shape[:2], 2)))
        if self.moved is not None:
            object.__setattr__(self, "moved", checked_shape("moved", self.moved, np.float32, self.maps.shape))
        if self.source.size and self.source.min() < 0:
            raise InputError("source must hold rows and columns of the sample, from 0")

    @checked_arguments
    def copy_of(self, sample: Array) -> Array:
        """Return any other map of the sample, arranged as this result is.

        Parameters
        ----------
        sample : (H, W) or (H, W, n) array
            A map of the sample's size.

        Returns
        -------
        array
            Of the result's rows and columns.

        Raises
        ------
        InputError
            If the sample is smaller than the result's positions reach.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> sample = np.tile(np.eye(8), (4, 4))
        >>> made = intaglio.quilt(sample, (40, 60), block=12, device="cpu")
        >>> bool((made.copy_of(1 - sample) == 1 - made.maps[:, :, 0]).all())
        True
        """
        rows, columns = (int(self.source[..., k].max(initial=-1)) + 1 for k in (0, 1))
        if sample.ndim not in (2, 3) or sample.shape[0] < rows or sample.shape[1] < columns:
            raise InputError(f"sample must be (H, W) or (H, W, n) of at least {rows} x {columns}, not {sample.shape}")
        return sample[self.source[..., 0], self.source[..., 1]]


def pixel_positions(shape: tuple[int, ...]) -> Array:
    """Return the row and column of every pixel, (H, W, 2) int32."""
    return np.stack(np.meshgrid(np.arange(shape[0]), np.arange(shape[1]), indexing="ij"), axis=2).astype(np.int32)


def copy_sample(
    maps: Any, values: Array, source: Array, *, tileable: bool, notes: tuple[str, ...], mask: Array | None = None
) -> Synthesis:
    """Return the result whose pixels are copied from ``values`` (H, W, n), the planes of ``maps``, at ``source`` (H, W, 2).

    ``mask`` (H, W) marks the usable pixels of the result, if it is a texture; None: all are.
    """
    texture = copy_texture(maps, source, mask) if isinstance(maps, Relightable) else None
    return Synthesis(np.ascontiguousarray(values[source[..., 0], source[..., 1]]), source, texture, tileable, notes)


def copy_texture(texture: Relightable, source: Array, mask: Array | None) -> Relightable:
    """Return a texture whose pixels are those of ``texture`` at ``source``."""
    at = (source[..., 0], source[..., 1])

    def copy_plane(plane: Array | None) -> Array | None:
        return None if plane is None else plane[at]

    return replace(
        texture,
        maps=texture.maps[:, at[0], at[1]],
        chroma=copy_plane(texture.chroma),
        height=copy_plane(texture.height),
        confidence=copy_plane(texture.confidence),
        mask=mask,
        notes=(*texture.notes, "synthesised from a sample"),
    )


def texture_of_planes(texture: Relightable, planes: Array) -> Relightable:
    """Return a texture of other values: ``planes`` (H, W, n) in the order of `texture_planes`."""
    height, width = planes.shape[:2]
    at = int(np.prod(texture.maps.shape)) // (height * width)
    maps = np.moveaxis(planes[:, :, :at].reshape(height, width, texture.maps.shape[0], *texture.maps.shape[3:]), 2, 0)
    found: dict[str, Any] = {"maps": np.ascontiguousarray(maps, texture.maps.dtype)}
    for name in ("chroma", "height", "confidence"):
        plane = getattr(texture, name)
        if plane is not None:
            count = plane.size // (height * width)
            found[name] = np.ascontiguousarray(planes[:, :, at : at + count].reshape(plane.shape), plane.dtype)
            at += count
    return replace(texture, **found)
