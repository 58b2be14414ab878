"""What synthesis gives: maps, and for every pixel where in the sample it comes from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from intaglio.arrays import Array
from intaglio.photometric import Relightable


@dataclass(frozen=True)
class Synthesis:
    """A synthesised texture.

    Attributes
    ----------
    maps : (H, W, n) array
        Copies of the sample's values: ``maps[y, x] == sample[source[y, x, 0], source[y, x, 1]]``, exactly. (Heights of a
        `Relightable` of kind ``"height"`` are copied less the sample's plane of best fit.)
    source : (H, W, 2) int32 array
        Row and column in the sample of each pixel.
    texture : Relightable, optional
        The same as a relightable texture, where the sample was one.
    tileable : bool
        Whether the result was made to wrap.
    notes : tuple of str
        What was chosen.
    """

    maps: Array
    source: Array
    texture: Relightable | None = None
    tileable: bool = False
    notes: tuple[str, ...] = ()

    def copy_of(self, sample: Array) -> Array:
        """Return any other map of the sample, (H, W) or (H, W, n), laid as this result was laid."""
        return sample[self.source[..., 0], self.source[..., 1]]


def places(shape: tuple[int, ...]) -> Array:
    """Return (H, W, 2) int32: each pixel's own row and column."""
    return np.stack(np.meshgrid(np.arange(shape[0]), np.arange(shape[1]), indexing="ij"), axis=2).astype(np.int32)


def copied(
    maps: Any, values: Array, source: Array, *, tileable: bool, notes: tuple[str, ...], mask: Array | None = None
) -> Synthesis:
    """Return the result whose pixels are copied from ``values`` (H, W, n), the planes of ``maps``.

    ``mask``: pixels of the result, as a texture, that can be used; default all.
    """
    texture = copied_texture(maps, source, mask) if isinstance(maps, Relightable) else None
    return Synthesis(np.ascontiguousarray(values[source[..., 0], source[..., 1]]), source, texture, tileable, notes)


def copied_texture(texture: Relightable, source: Array, mask: Array | None) -> Relightable:
    """Return a texture whose pixels are those of ``texture`` at ``source``."""
    at = (source[..., 0], source[..., 1])

    def moved(plane: Array | None) -> Array | None:
        return None if plane is None else plane[at]

    return replace(
        texture,
        maps=texture.maps[:, at[0], at[1]],
        chroma=moved(texture.chroma),
        height=moved(texture.height),
        confidence=moved(texture.confidence),
        mask=mask,
        notes=(*texture.notes, "synthesised from a sample"),
    )
