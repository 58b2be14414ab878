"""Symmetry and repetition: parts of a scan that are like the surroundings of a hole, and the hole filled from them."""

from intaglio.relief.symmetry.filling import LikeFilling, Likes, given_poses

__all__ = ["LikeFilling", "Likes", "given_poses"]
