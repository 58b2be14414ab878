"""Geometry textures from point sets (Duranleau & Poulin)."""
