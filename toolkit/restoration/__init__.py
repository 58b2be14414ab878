"""Filling what is missing of an image."""
