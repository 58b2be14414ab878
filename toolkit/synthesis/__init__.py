"""Larger textures from small samples, in any number of dimensions (Dong, chapters 5 and 6)."""
