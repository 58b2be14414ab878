"""Poses: rigid motions, mirror images among them, that carry one part of a scan onto another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array


@dataclass(frozen=True)
class Pose:
    """A rigid motion x -> turn x + shift, which may mirror.

    Attributes
    ----------
    turn : (3, 3) array
        Orthogonal; its determinant is -1 where the pose mirrors.
    shift : (3,) array
    """

    turn: Array
    shift: Array

    @property
    def mirrors(self) -> bool:
        """Whether the pose mirrors."""
        return bool(np.linalg.det(self.turn) < 0)

    def apply(self, points: Array) -> Array:
        """Return where points (N, 3) come to lie."""
        return np.asarray(points @ self.turn.T + self.shift)

    def inverse(self) -> Pose:
        """Return the pose that carries back."""
        return Pose(self.turn.T, -self.turn.T @ self.shift)

    def after(self, rotation: Array, move: Array) -> Pose:
        """Return the pose that is followed by x -> rotation x + move."""
        return Pose(rotation @ self.turn, rotation @ self.shift + move)

    def describe(self) -> str:
        """Return the pose in words."""
        if self.mirrors:
            # A mirror's normal is the eigenvector to -1.
            values, vectors = np.linalg.eig(self.turn)
            normal = np.real(vectors[:, np.argmin(np.abs(values + 1))])
            along = self.shift - normal * (normal @ self.shift)
            angle = np.arccos(np.clip((np.trace(self.turn) + 1) / 2, -1, 1))
            plain = angle < 0.05 and np.linalg.norm(along) < 0.1 * np.linalg.norm(self.shift)
            return "a mirror image" + ("" if plain else ", moved")
        angle = np.degrees(np.arccos(np.clip((np.trace(self.turn) - 1) / 2, -1, 1)))
        return f"moved by {np.linalg.norm(self.shift):.4g}" if angle < 2 else f"turned by {angle:.0f} degrees"
