"""Relief from other scans: where it may come from, what is kept of it, and what can't serve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import intaglio
from intaglio import InputError, Surface
from intaglio.relief.exemplar import chosen_sources
from intaglio.relief.ground import prepare_ground
from intaglio.relief.transfer import beside, lay_exemplars
from tests.test_cli import run
from tests.test_coherent import ripples, sheet, without

SMOOTH = {"symmetry": "none", "guides": "none"}


def moved(surface, seed=1):
    """The surface as another scan would hold it: turned and elsewhere."""
    turn = Rotation.random(random_state=seed).as_matrix()
    return replace(surface, vertices=surface.vertices @ turn.T + [400.0, -30, 70], base=None, normal=None)


@pytest.fixture(scope="module")
def bare():
    """A sheet with a hole, rippled around it alone: its own surroundings are the same that the other scan has."""
    return without(sheet(ripples), (17, 17, 5))


@pytest.fixture(scope="module")
def other():
    return moved(sheet(ripples, seed=8))


def off(whole):
    filled = whole.vertices[~whole.measured]
    return float(np.sqrt(((filled[:, 2] - ripples(filled[:, 0], filled[:, 1])) ** 2).mean()))


@pytest.mark.parametrize("exemplar", ["other", "both"])
def test_relief_comes_from_another_scan(bare, other, exemplar):
    given = other if exemplar == "other" else ["near", other]
    whole = intaglio.complete_relief(bare, "smooth", exemplar=given, **SMOOTH)
    filled = ~whole.measured
    assert np.array_equal(whole.vertices[whole.measured], bare.vertices)
    # Ripples of 0.6: where they were not met the error would be 0.4 and more.
    assert off(whole) < 0.25
    if exemplar == "other":
        assert (whole.exemplar[filled] == 1).all()
        assert (whole.source[filled] == -1).all()
        assert (whole.exemplar_source[filled] >= 0).all()
        assert whole.exemplar_source.max() < len(other.vertices)
        assert any(note.startswith("exemplar 1: 1296 vertices") for note in whole.notes)
    known = (whole.source >= 0) if whole.exemplar is None else (whole.source >= 0) ^ (whole.exemplar > 0)
    assert known.all()


def test_provenance_of_several_scans_is_exact(bare, other, tmp_path):
    color = np.random.default_rng(0).uniform(0, 1, (3, len(other.vertices), 3)).astype(np.float32)
    own = replace(bare, color=color[0, : len(bare.vertices)])
    scans = [replace(other, color=color[1]), replace(moved(other, 2), color=color[2])]
    whole = intaglio.complete_relief(own, "smooth", exemplar=scans, **SMOOTH)
    for at in np.flatnonzero(~whole.measured):
        which = whole.exemplar[at]
        assert np.array_equal(whole.color[at], scans[which - 1].color[whole.exemplar_source[at]])
    intaglio.write_surface(whole, tmp_path / "whole.ply")
    again = intaglio.read_surface(tmp_path / "whole.ply")
    assert np.array_equal(again.exemplar, whole.exemplar)
    assert np.array_equal(again.exemplar_source, whole.exemplar_source)
    report = intaglio.assess_relief(again, device="cpu")
    # No source of its own: nothing can be said of how near they are.
    assert np.isnan(report.local_share)


def test_the_same_bits_wherever_the_other_scan_lies(bare, other):
    one, two = (intaglio.complete_relief(bare, "smooth", exemplar=scan, **SMOOTH) for scan in (other, other))
    assert np.array_equal(one.vertices, two.vertices)
    assert np.array_equal(one.exemplar_source, two.exemplar_source)


def test_other_scans_lie_far_from_the_ground(bare, other):
    ground = prepare_ground(bare, "smooth")
    exemplars = lay_exemplars([other], ground)
    both = beside(ground, exemplars)
    count = len(ground.foot)
    assert both.measured[count:].all()
    gap = both.foot[count:, 0].min() - both.foot[:count, 0].max()
    assert gap >= np.ptp(both.foot[:count], axis=0).max()
    # Relief is a length along the normal: moving doesn't change it.
    own = np.einsum("ij,ij->i", other.vertices - exemplars.foot, exemplars.normal)
    np.testing.assert_allclose(both.height[count:], own, atol=1e-9)
    # A smooth sheet's base is smooth: ripples stay relief.
    assert own.std() > 0.3
    np.testing.assert_array_equal(exemplars.number, np.arange(len(other.vertices)))


def test_of_a_large_scan_the_middle_serves(bare):
    large = sheet(ripples, side=230)
    exemplars = lay_exemplars([large], prepare_ground(bare, "smooth"))
    assert 30_000 < len(exemplars.foot) <= 40_000
    assert "of 52900" in exemplars.notes[0]
    np.testing.assert_array_equal(large.vertices[exemplars.number], exemplars.vertices)


def test_what_cannot_serve_is_refused(bare, other):
    def complete(scan, exemplar, **more):
        return intaglio.complete_relief(scan, "smooth", exemplar=exemplar, **SMOOTH, **more)

    coarse = replace(other, vertices=3 * other.vertices, base=None, normal=None)
    with pytest.raises(InputError, match=r"exemplar 2 is 3\.0 times as coarse"):
        complete(bare, [other, coarse])
    with pytest.raises(InputError, match="exemplar 1 holds 5 vertices that were filled"):
        complete(bare, replace(other, measured=np.arange(len(other.vertices)) >= 5))
    with pytest.raises(InputError, match="exemplar 1: the surface is empty"):
        complete(bare, Surface(vertices=other.vertices, faces=np.zeros((0, 3), np.int32)))
    with pytest.raises(InputError, match="exemplar 1 has no colour"):
        complete(replace(bare, color=np.zeros(bare.vertices.shape, np.float32)), other)
    with pytest.raises(InputError, match="'near' or 'all' once at most"):
        complete(bare, ["far", other])
    with pytest.raises(InputError, match="'near' or 'all' once at most"):
        complete(bare, ["near", "all", other])
    with pytest.raises(InputError, match="'near' or 'all' once at most"):
        complete(bare, ["near", "all"])
    with pytest.raises(InputError, match="symmetry and exemplar"):
        intaglio.complete_relief(bare, "smooth", exemplar=other, symmetry=(1, 0, 0, 3.0))
    with pytest.raises(InputError, match="exemplar holds other scans, which go with method='pieces'"):
        intaglio.complete_relief(bare, "smooth", exemplar=other, window=3)


def test_choices_of_sources(bare, other):
    near, everything = chosen_sources(bare, "near"), chosen_sources(bare, "all")
    assert near.allowed is None
    assert near.near
    assert everything.allowed.all()
    assert not everything.near
    alone, beside_near, beside_all = (chosen_sources(bare, e) for e in (other, ["near", other], (other, "all")))
    assert not alone.allowed.any()
    assert alone.near
    assert beside_near.allowed is None
    assert beside_all.allowed.all()
    assert [len(s.others) for s in (near, alone, beside_near, beside_all)] == [0, 1, 1, 1]


def test_a_textured_scan_says_why_its_filling_has_none(bare, other):
    from tests.test_filling_texture import png

    uv = bare.vertices[bare.faces][:, :, :2] / 36
    textured = replace(bare, uv=uv, picture=png(np.full((8, 8, 3), 120, np.uint8)))
    whole = intaglio.complete_relief(textured, "smooth", exemplar=other, **SMOOTH)
    assert "its relief comes from other scans" in whole.notes[-1]


def test_the_command_takes_files(tmp_path, monkeypatch, capsys, bare, other):
    bare.write(tmp_path / "scan.ply")
    other.write(tmp_path / "other.ply")
    base = ("complete", tmp_path / "scan.ply", "--base", "smooth", "-o", tmp_path / "whole.ply", "--guides", "none")
    status, _, said = run(monkeypatch, capsys, *base, "--exemplar", tmp_path / "other.ply", "--exemplar", "near")
    assert status == 0
    assert "exemplar 1: 1296 vertices" in said
    status, _, said = run(monkeypatch, capsys, *base, "--exemplar", tmp_path / "missing.ply")
    assert status != 0
    assert "no such file" in said
    status, _, said = run(monkeypatch, capsys, *base, "--exemplar", "0,0,0,4", "--exemplar", tmp_path / "other.ply")
    assert status != 0
    assert "takes a ball alone" in said
