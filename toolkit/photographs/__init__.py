"""Texturing a mesh from photographs."""
