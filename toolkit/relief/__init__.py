"""Completing missing relief: Breckon & Fisher's two stages."""
