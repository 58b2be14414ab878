"""The scenes of larger textures, on small pieces."""

from __future__ import annotations

import argparse

import numpy as np
import pytest

from intaglio import read_image
from intaglio.scenes import larger_materials, larger_photographs, larger_relightables


@pytest.fixture
def args(tmp_path):
    return argparse.Namespace(output=tmp_path, seed=1, device=None)


def test_photographs(args):
    figures = larger_photographs.run(args, size=160, names=("brick", "gravel"))
    assert set(figures) == {"brick", "gravel"}
    for blocks, pixels, woven in figures.values():
        assert woven.seam < 1.1
        assert woven.seam < blocks.seam
        assert pixels.likeness.coherence < 0.5
    assert read_image(args.output / "larger_photographs.png").shape[0] == 2 * 164


@pytest.mark.slow
def test_materials(args, real):
    real("materials/godot_wool")
    report = larger_materials.run(args, size=192, names=("wool",))["wool"]
    assert report.wrap < 1.15
    assert report.seam < 1.05
    assert report.likeness.coherence < 0.2
    assert (args.output / "larger_materials.html").exists()


@pytest.mark.slow
def test_relightables(args, monkeypatch):
    monkeypatch.setenv("INTAGLIO_DATA", str(args.output))
    (figures,) = larger_relightables.run(args, size=64, result=112).values()
    assert set(figures) == set(larger_relightables.APPROACHES)
    for kind, report in figures.items():
        # Relit as the sample is relit: what the maps have together is kept.
        for found in report.relit.values():
            assert found.coherence < (0.45 if kind == "height" else 0.2)
    light = np.array([0.3, 0.2, 0.9])
    surface = larger_relightables.thesis_surfaces(64, 1)[0]
    texture = larger_relightables.represent(surface.stack(samples=4, seed=1), "ptm")
    assert larger_relightables.rendered_difference(texture, light) < 1e-5
