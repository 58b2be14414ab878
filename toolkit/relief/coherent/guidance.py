"""What is known of a filling beforehand: lines that go on across the hole."""

from __future__ import annotations

from dataclasses import dataclass

from intaglio.arrays import Array


@dataclass(frozen=True)
class Guidance:
    """Lines across a hole.

    Attributes
    ----------
    vertices : (K,) int array
        Targets that lie on lines.
    points : (K, 3) array
        Where these lie on them, in the input's unit.
    nearness : (N,) array
        How near a line every vertex is: from 1 on a ridge and -1 in a valley to 0 far from all. Of the measured ones only such
        lines count as go on in the hole.
    weight : float
        How sure the lines are, in edges.
    """

    vertices: Array
    points: Array
    nearness: Array
    weight: float = 2.0
