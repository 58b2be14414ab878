"""The scenes of photographs and restoration, on small pieces."""

from __future__ import annotations

import argparse

import pytest

from intaglio import read_image
from intaglio.scenes import photographed_head, photographed_objects, restoration


@pytest.fixture
def args(tmp_path):
    return argparse.Namespace(output=tmp_path, seed=1, device=None)


@pytest.mark.slow
def test_photographed_head(args, real):
    real("meshes/lee_perry_smith_head/LeePerrySmith.glb")
    found = photographed_head.run(args, size=480, texels=384, samples=64)
    assert found.laid.flips == 0
    assert found.plain_step > 2
    assert found.step < 1.1
    for view, psnr in found.psnr.items():
        assert psnr > found.plain_psnr[view]
    assert (args.output / "photographed_head.glb").exists()


@pytest.mark.slow
def test_photographed_objects(args, real):
    real("multiview/middlebury_templeSparseRing")
    found = photographed_objects.run(args, names=("temple",), texels=1024, most=1)
    best, plain, vertex = (
        found["temple", "templeSR0002.png", m].psnr for m in ("best view, spline", "plain average", "colours at vertices")
    )
    assert best > 15
    assert plain > 15
    assert vertex > 10


def test_restoration(args, monkeypatch, real):
    real(restoration.SOURCES["bark"])
    monkeypatch.setattr(restoration, "SOURCES", {"bark": restoration.SOURCES["bark"]})
    found = restoration.run(args, size=(180, 240))
    assert found["shading alone", "split"].psnr > 40
    for name in ("bark", "bark, gradient"):
        split, inpaint = found[name, "split"], found[name, "inpaint"]
        assert abs(split.energy / split.truth_energy - 1) < 0.5 * abs(inpaint.energy / inpaint.truth_energy - 1)
        assert split.seam < 1.15 * split.truth_seam
    assert read_image(args.output / "restoration.png").shape[0] == 3 * 184
