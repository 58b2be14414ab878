"""The scenes of geometry textures: what they are made of, and (slow) what they show."""

from __future__ import annotations

import argparse
import re
import warnings

import numpy as np
import pytest

from intaglio import IntaglioWarning, PointSet
from intaglio.scenes import geometry_textures, weave_on_vase
from intaglio.scenes.connections import broken_threads, closed_rings
from intaglio.scenes.swatches import chain_mail, flowers, swept, weave


def test_a_swept_circle_is_a_torus():
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    line = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    points, normals = swept(line, 0.2, 0.05, closed=True)
    ring = points[:, :2] / np.linalg.norm(points[:, :2], axis=1, keepdims=True)
    away = points - np.concatenate([ring, np.zeros((len(points), 1))], axis=1)
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 0.2, atol=1e-3)
    np.testing.assert_allclose(normals, away / 0.2, atol=0.02)
    assert len(points) == pytest.approx(4 * np.pi**2 * 0.2 / 0.05**2, rel=0.15)


@pytest.mark.parametrize("make", [lambda: weave(3, 0.12), lambda: chain_mail(2, 2, 0.12), lambda: flowers(2, 2, 0.08)])
def test_swatches_face_outwards_and_are_numbered(make):
    points, normals, label = make()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-9)
    assert set(label.tolist()) == set(range(label.max() + 1))
    for number in range(label.max() + 1):
        mine = label == number
        assert ((points[mine] - points[mine].mean(axis=0)) * normals[mine]).sum() > 0


def test_no_two_threads_of_a_weave_are_alike():
    points, _, label = weave(4, 0.12)
    heights = [points[label == k, 2].max() for k in range(8)]
    assert len(set(np.round(heights, 4))) == 8


def test_cut_threads_and_rings_are_counted():
    points, normals, label = weave(5, 0.1)
    inside = ((points[:, :2] > -0.4) & (points[:, :2] < 4.4)).all(axis=1)
    whole = PointSet(points[inside], normals[inside])
    assert broken_threads(whole, 0.1) == (10, 0)
    gap = (label[inside] == 2) & (np.abs(whole.points[:, 1] - 2.5) < 0.3)
    assert broken_threads(whole.part(~gap), 0.1) == (11, 2)
    points, normals, label = chain_mail(3, 4, 0.09)
    mail = PointSet(points, normals)
    rings, closed = closed_rings(mail, 0.09, 1.0)
    assert rings == closed > 1
    low, high = points.min(axis=0) + 0.2, points.max(axis=0) - 0.2
    rims = [(points[label == k].min(axis=0), points[label == k].max(axis=0)) for k in range(12)]
    middle = next(k for k, (a, b) in enumerate(rims) if (a[:2] > low[:2]).all() and (b[:2] < high[:2]).all())
    cut = (label == middle) & (points[:, 0] > points[label == middle, 0].max() - 0.6)
    assert closed_rings(mail.part(~cut), 0.09, 1.0) == (rings, closed - 1)


def test_the_vase_is_laid_flat_without_shear_and_closes():
    vertices, faces, uv = weave_on_vase.vase(48, 48)
    edges = vertices[faces[:, 1:]] - vertices[faces[:, :1]]
    flat = uv[faces[:, 1:]] - uv[faces[:, :1]]
    jacobian = np.einsum("fki,fkj->fij", np.linalg.inv(flat).transpose(0, 2, 1), edges)
    values = np.linalg.svd(jacobian * [[1.0], [1.0]], compute_uv=False)
    # u runs once around, v along: their scales differ by one factor all over the vase.
    ratio = values[:, 0] / values[:, 1]
    assert ratio.std() / ratio.mean() < 0.05
    np.testing.assert_array_equal(vertices[:48], vertices[-48:])


@pytest.mark.slow
@pytest.mark.parametrize("name", [*geometry_textures.EXTENSIONS, "weave_on_vase"])
def test_a_scene_runs_and_shows_what_it_should(name, tmp_path, capsys, real):
    args = argparse.Namespace(output=tmp_path, seed=1, device=None)
    if name in geometry_textures.EXTENSIONS and geometry_textures.EXTENSIONS[name].data:
        real(geometry_textures.EXTENSIONS[name].data)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", IntaglioWarning)
        if name == "weave_on_vase":
            weave_on_vase.run(args)
        else:
            geometry_textures.run(args, names=(name,))
    said = capsys.readouterr().out
    assert (tmp_path / f"{name}.ply").exists()
    assert (tmp_path / f"{name}.png").exists()
    if name == "weave_on_vase":
        assert (tmp_path / "weave_on_vase.glb").exists()
        return
    assert 0.9 < float(re.search(r"nearest neighbours ([\d.]+)", said)[1]) < 1.1
    assert float(re.search(r"local surface: ([\d.]+)°", said)[1]) < 10
    assert float(re.search(r"step at patch borders: ([\d.]+)", said)[1]) < 0.5
    if name == "weave":
        broken, threads = re.search(r"result: (\d+) of (\d+) threads broken", said).groups()
        assert int(broken) <= 0.02 * int(threads)
    if name == "chain_mail":
        closed, rings = re.search(r"result: (\d+) of (\d+) rings closed", said).groups()
        assert int(closed) >= 0.98 * int(rings)
