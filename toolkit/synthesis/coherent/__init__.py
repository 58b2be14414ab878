"""Synthesis by coherent pieces: even starts from blocks on a coarse level, then patches and borders level by level."""
