"""Completion by coherent pieces: joining, surroundings, holes one by one, exemplars, what is kept, and how well it fills."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

import intaglio
from intaglio import InputError, ReliefSettings, Surface
from intaglio.kernels.launch import set_threads
from intaglio.mesh import border_loops, directed_edges, grid_faces
from intaglio.relief import regions, without_relief
from intaglio.relief.coherent import fill_coherently
from intaglio.relief.coherent.averages import BANDS, average, averaging, bands, edges_from
from intaglio.relief.coherent.joining import Wishes, join
from intaglio.relief.coherent.search import FieldSearch, Weights
from intaglio.relief.coherent.surroundings import Surroundings, slopes
from intaglio.relief.exemplar import chosen_vertices
from intaglio.relief.ground import GroundOptions, prepare_ground
from intaglio.scenes.cut_holes import CASES, cut_hole
from intaglio.scenes.patterns import plane_base

# Small holes are enough for facts; quality is measured on holes of 8.
SIDE, RADIUS = 36, 4.0


def sheet(height, *, side=SIDE, jitter=0.2, seed=0):
    """A sheet of heights over a lattice of unit steps, shaken by up to ``jitter``."""
    x, y = np.meshgrid(np.arange(float(side)), np.arange(float(side)))
    move = np.random.default_rng(seed).uniform(-jitter, jitter, (2, side, side))
    x, y = x + move[0], y + move[1]
    vertices = np.stack([x, y, height(x, y) + 0 * x], axis=-1).reshape(-1, 3)
    return Surface(vertices=vertices, faces=grid_faces(side, side)[:, ::-1])


def without(surface, *holes):
    """Return the surface without what lies over circles (x, y, radius)."""
    keep = np.ones(len(surface.vertices), bool)
    for x, y, radius in holes:
        keep &= np.hypot(surface.vertices[:, 0] - x, surface.vertices[:, 1] - y) >= radius
    return surface.part(keep)


def ripples(x, y):
    return 0.6 * np.sin(2 * np.pi * (x + 0.5 * y) / 6.5)


def bumps(x, y):
    return 0.5 * np.sin(1.1 * x + 0.3 * y) + 0.4 * np.cos(0.4 * x - 0.9 * y)


def rough(size, seed=3):
    """Heights (size, size) at random whose waves are some 6 to 15 long, periodic, of standard deviation 0.5."""
    white = np.random.default_rng(seed).normal(size=(size, size))
    k = np.fft.fftfreq(size)
    made = np.real(np.fft.ifft2(np.fft.fft2(white) * np.exp(-(k[:, None] ** 2 + k**2) / (2 * 0.12**2))))
    return 0.5 * made / made.std()


def complete(scan, settings=None, base="smooth", *, seed=1, device="cpu", near=True, progress=None, **options):
    """Prepare and complete, with what is given going where it belongs."""
    ground = {"extent": "holes"} if base != "smooth" else {}
    call = {"exemplar": options.pop("exemplar")} if "exemplar" in options else {}
    prepared = intaglio.prepare_relief(scan, base, near=near, device=device, **ground)
    return prepared.complete(settings or ReliefSettings(method="pieces", **options), seed=seed, progress=progress, **call)


HOLE = (SIDE / 2, SIDE / 2, RADIUS)


@pytest.fixture(scope="module")
def scan():
    return without(sheet(bumps), HOLE)


@pytest.fixture(scope="module")
def whole(scan):
    return complete(scan)


@pytest.fixture(scope="module")
def ground(scan):
    return prepare_ground(scan, "smooth")


def as_bytes(surface):
    return [getattr(surface, name).tobytes() for name in ("vertices", "source", "rotation", "error", "confidence")]


def assert_all_filled(surface):
    """Every filled vertex is finite, on a face, and has a measured source; the only border is the outer one."""
    assert np.isfinite(surface.vertices).all()
    filled = ~surface.measured
    assert np.isin(np.flatnonzero(filled), surface.faces).all()
    assert surface.measured[surface.source[filled]].all()
    assert np.unique(np.sort(directed_edges(surface.faces), axis=1), axis=0, return_counts=True)[1].max() == 2
    assert len(border_loops(surface.faces)) == 1


def beside_the_filling(surface):
    """Return the measured vertices that share a face with a filled one."""
    corners = surface.faces[(~surface.measured)[surface.faces].any(axis=1)]
    return np.unique(corners[surface.measured[corners]])


# Exact facts


@pytest.mark.parametrize("base", ["smooth", plane_base()])
def test_measured_vertices_keep_their_bits_their_order_and_their_faces(scan, base):
    made = complete(scan, base=base)
    count = len(scan.vertices)
    assert made.vertices[:count].tobytes() == scan.vertices.tobytes()
    np.testing.assert_array_equal(made.measured, np.arange(len(made.vertices)) < count)
    np.testing.assert_array_equal(made.faces[: len(scan.faces)], scan.faces)
    np.testing.assert_array_equal(made.measured_face, np.arange(len(made.faces)) < len(scan.faces))
    np.testing.assert_array_equal(made.source[:count], np.arange(count))
    assert (made.rotation[:count] == 0).all()
    assert (made.error[:count] == 0).all()
    assert (made.confidence[:count] == 1).all()
    filled = ~made.measured
    assert ((made.confidence[filled] >= 0) & (made.confidence[filled] < 1)).all()
    assert ((made.error[filled] >= 0) & np.isfinite(made.error[filled])).all()
    assert ((made.rotation[filled] >= 0) & (made.rotation[filled] < 2 * np.pi)).all()
    assert_all_filled(made)


@pytest.mark.parametrize("base", ["smooth", "plane"])
@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.4, -0.3)])
def test_a_plane_in_a_plane_out(base, tilt):
    scan = without(sheet(lambda x, y: tilt[0] * x + tilt[1] * y), HOLE)
    made = complete(scan, base=base)
    x, y, z = made.vertices[~made.measured].T
    assert len(z) > 20
    # Steps are in single precision, of heights of some 1e-7 at most.
    assert np.abs(z - tilt[0] * x - tilt[1] * y).max() < 1e-6
    assert "the scan has no relief over its base: what was filled is the smooth surface" in made.notes


def test_threads_and_seeds(scan, whole):
    made = []
    try:
        for count in (1, 2):
            set_threads(count)
            made.append(as_bytes(complete(scan)))
    finally:
        set_threads(None)
    assert made[0] == made[1] == as_bytes(whole)
    other = complete(scan, seed=2)
    assert (other.source != whole.source).any()
    assert (other.vertices != whole.vertices).any()


def test_every_device_completes_alike_in_kind(scan, device):
    made = complete(scan, device=device)
    assert_all_filled(made)
    assert f"device {device}" in " ".join(made.notes)


def test_progress_counts_up_to_all(scan):
    seen = []
    complete(scan, progress=lambda *step: seen.append(step))
    done, total = np.array(seen).T
    assert (total == total[-1]).all() or len(set(total)) > 1
    assert (np.diff(done / total) >= 0).all()
    assert done[-1] == total[-1]


def test_what_was_measured_stays_where_colours_are_carried():
    colored = sheet(bumps)
    color = np.random.default_rng(0).uniform(0, 1, colored.vertices.shape).astype(np.float32)
    scan = without(replace(colored, color=color), HOLE)
    made = complete(scan)
    assert made.color[: len(scan.vertices)].tobytes() == scan.color.tobytes()
    np.testing.assert_array_equal(made.color, made.color[made.source])


def test_holes_are_filled_one_by_one_each_from_what_surrounds_it():
    # Left bumps, right ripples: far enough from one another that neither hole's surroundings hold the other's relief.
    scan = without(sheet(lambda x, y: np.where(x < 56, bumps(x, y), ripples(x, y)), side=112), (12, 56, 4), (100, 56, 5))
    scan = scan.part(np.abs(scan.vertices[:, 1] - 56) < 18)
    seen = []
    made = complete(scan, seed=0, progress=lambda *step: seen.append(step))
    assert_all_filled(made)
    filled = ~made.measured
    left = made.vertices[:, 0] < 56
    assert (filled & left).sum() > 30
    assert (filled & ~left).sum() > 30
    assert left[made.source[filled & left]].all()
    assert not left[made.source[filled & ~left]].any()
    assert np.array(seen)[-1, 0] == np.array(seen)[-1, 1]
    # What lies far from both has no base of its own.
    own = np.flatnonzero(made.measured & (np.abs(made.vertices[:, 0] - 54.5) < 3))
    np.testing.assert_array_equal(made.base[own], made.vertices[own])
    assert (made.base != made.vertices).any(axis=1)[filled].any()


def test_an_exemplar_holds_for_every_hole():
    scan = without(sheet(bumps, side=72), (12, 36, 4), (60, 36, 4))
    scan = scan.part(np.abs(scan.vertices[:, 1] - 36) < 12)
    chosen = scan.vertices[:, 0] < 24
    made = complete(scan, near=False, exemplar=chosen)
    filled = ~made.measured
    assert (made.vertices[filled, 0] > 36).any()
    assert chosen[made.source[filled]].all()


@pytest.mark.parametrize("exemplar", ["near", "all"])
def test_near_means_what_surrounds_a_hole_and_all_means_all(exemplar, monkeypatch):
    scan = without(sheet(bumps, side=90), (12, 45, 4), (78, 45, 4))
    scan = scan.part(np.abs(scan.vertices[:, 1] - 45) < 12)
    seen = []

    def watched(region, allowed, **options):
        seen.append((region, allowed))
        return fill_coherently(region, allowed, **options)

    monkeypatch.setattr(regions, "fill_coherently", watched)
    complete(scan, near=False, exemplar=exemplar)
    assert len(seen) == 2
    for region, allowed in seen:
        may = region.measured if allowed is None else allowed
        assert may[region.measured].all()
        assert may.sum() == len(scan.vertices) if exemplar == "all" else may.sum() < 0.7 * len(scan.vertices)


@pytest.mark.parametrize("kind", ["mask", "numbers", "ball", "near", "all"])
def test_sources_are_measured_and_of_the_exemplar(scan, kind):
    ball = (9.0, 18.0, 0.0, 8.0)
    inside = np.linalg.norm(scan.vertices - ball[:3], axis=1) <= ball[3]
    given = {"mask": inside, "numbers": np.flatnonzero(inside), "ball": ball}.get(kind, kind)
    made = complete(scan, near=kind == "near", exemplar=given)
    source = made.source[~made.measured]
    assert (source < len(scan.vertices)).all()
    # Where the surface goes on unmeasured nothing is taken.
    assert not np.isin(source, beside_the_filling(made)).any()
    assert inside[source].all() == (kind not in ("near", "all"))


def test_an_exemplar_is_chosen_in_three_ways(scan):
    inside = np.linalg.norm(scan.vertices - (9, 18, 0), axis=1) <= 5
    for given in (inside, np.flatnonzero(inside), (9, 18, 0, 5), np.array([9.0, 18, 0, 5]), [9, 18, 0, 5]):
        np.testing.assert_array_equal(chosen_vertices(scan, given), inside)
    assert chosen_vertices(scan, "near") is None


@pytest.mark.parametrize(
    ("exemplar", "message"),
    [
        ("far", "not 'far'"),
        (np.ones(7, bool), r"shape \(\d+,\), not \(7,\)"),
        (np.array([0, 1, 10**6]), "names vertices from 0 to 1000000"),
        (np.array([-1, 1, 3]), "from -1 to 3"),
        (np.zeros(0, int), "selects no vertex"),
        ((1.0, 2.0, 3.0), "a ball"),
        ((1.0, 2.0, 3.0, -1.0), "radius above 0"),
        ((1.0, float("nan"), 3.0, 1.0), "finite centre"),
        ((1e4, 1e4, 1e4, 1.0), "selects no vertex"),
        (np.zeros((4, 2)), "a ball"),
    ],
)
def test_exemplars_that_cannot_be_used_are_named(scan, exemplar, message):
    with pytest.raises(InputError, match=message):
        chosen_vertices(scan, exemplar)


def test_an_exemplar_on_the_rim_alone_leaves_nothing_to_take(scan, whole):
    with pytest.raises(InputError, match="has measured surface around it"):
        complete(scan, exemplar=beside_the_filling(whole))


@pytest.mark.parametrize("gone", [1, 2])
def test_rims_of_three_and_four_edges_are_closed_without_a_vertex(gone):
    surface = sheet(bumps)
    # The two triangles that share a square's diagonal.
    square = np.flatnonzero((np.abs(surface.vertices[surface.faces].mean(axis=1)[:, :2] - SIDE / 2) < 0.75).all(axis=1))[:1]
    shared = (np.isin(surface.faces, surface.faces[square]).sum(axis=1) == 2).nonzero()[0][:1]
    scan = replace(surface, faces=np.delete(surface.faces, np.concatenate([square, shared])[:gone], axis=0))
    assert [len(loop) for loop in border_loops(scan.faces)][1:] == [2 + gone]
    made = complete(scan)
    assert made.vertices.tobytes() == scan.vertices.tobytes()
    assert len(made.faces) == len(surface.faces)
    assert made.measured_face.sum() == len(scan.faces)
    assert_all_filled(made)


def test_a_hole_of_one_vertex_beside_one_of_many():
    scan = without(sheet(bumps), (9, 9, 0.5), (24, 24, 4))
    made = complete(scan)
    assert_all_filled(made)
    assert made.vertices[: len(scan.vertices)].tobytes() == scan.vertices.tobytes()


def test_a_hole_in_a_closed_scan_far_from_the_origin():
    made = trimesh.creation.icosphere(subdivisions=4, radius=10.0)
    v = np.asarray(made.vertices)
    v = v * (1 + 0.02 * np.sin(1.3 * v[:, :1]) * np.cos(1.1 * v[:, 1:2])) + (5e5, 4e6, 100)
    scan = Surface(vertices=v, faces=np.asarray(made.faces)).part(v[:, 2] < 109)
    for base in ("smooth", "sphere"):
        closed = complete(scan, base=base)
        assert closed.vertices[closed.measured].tobytes() == scan.vertices.tobytes()
        assert (np.unique(np.sort(directed_edges(closed.faces), axis=1), axis=0, return_counts=True)[1] == 2).all()
        radius = np.linalg.norm(closed.vertices[~closed.measured] - (5e5, 4e6, 100), axis=1)
        assert np.abs(radius - 10).max() < 0.5


def test_the_unit_of_length_does_not_matter(scan, whole):
    # Powers of two change no digit.
    for scale in (2.0**-10, 2.0**12):
        made = complete(replace(scan, vertices=scan.vertices * scale, base=None, normal=None))
        np.testing.assert_array_equal(made.source, whole.source)
        np.testing.assert_allclose(made.vertices / scale, whole.vertices, atol=1e-9)


def test_a_part_of_the_ground_holds_one_hole_and_what_surrounds_it():
    scan = without(sheet(bumps, side=90), (15, 45, 4), (75, 45, 4))
    ground = prepare_ground(scan, "smooth", GroundOptions(near=False))
    targets = np.flatnonzero(~ground.measured & (ground.foot[:, 0] < 45))
    others = np.flatnonzero(~ground.measured & (ground.foot[:, 0] > 45))
    part, keep = ground.around(targets)
    assert keep[targets].all()
    assert not keep[others].any()
    np.testing.assert_array_equal(np.flatnonzero(~part.measured), np.searchsorted(np.flatnonzero(keep), targets))
    for name in ("vertices", "foot", "normal", "measured", "u", "v"):
        np.testing.assert_array_equal(getattr(part, name), getattr(ground, name)[keep])
    at = np.flatnonzero(keep)
    # All faces whose corners are kept, in their order.
    np.testing.assert_array_equal(at[part.faces], ground.faces[keep[ground.faces].all(axis=1)])
    np.testing.assert_array_equal(part.base.vertices, part.foot)
    np.testing.assert_array_equal(part.topology.neighbors, type(part.topology).of(part.faces, len(at)).neighbors)
    # Near is all of a disc of some radii around, far is none.
    distance = np.hypot(*(ground.foot[:, :2] - (15, 45)).T)
    assert keep[ground.measured & (distance < 12)].all()
    assert not keep[distance > 40].any()
    # All that was measured, if that is asked for, but still no other hole's targets.
    np.testing.assert_array_equal(np.flatnonzero(~ground.around(targets, near=False)[1]), others)


# Settings


def test_the_method_follows_what_is_asked_for():
    assert ReliefSettings(rotations=1).method is None
    assert ReliefSettings(rotations=1, mirror=True).method == "pieces"
    assert ReliefSettings(window=5).method == "propagation"
    assert ReliefSettings(method="propagation").method == "propagation"
    for option in ({"window": 5}, {"levels": 2}, {"refine": 1}, {"metric": "surface"}, {"oversample": 1}):
        with pytest.raises(InputError, match=f"{next(iter(option))} goes with method='propagation'"):
            ReliefSettings(method="pieces", **option)
    with pytest.raises(InputError, match="mirror goes with method='pieces'"):
        ReliefSettings(mirror=True, window=5)
    with pytest.raises(InputError, match="method"):
        ReliefSettings(method="patches")


@pytest.mark.parametrize(("base", "method"), [("smooth", "filled by pieces"), (plane_base(), "grown in")])
def test_the_default_method_follows_the_base(scan, base, method):
    options = {} if base == "smooth" else {"extent": "holes"}
    assert any(method in note for note in intaglio.complete_relief(scan, base, **options).notes)


def test_both_methods_run_on_one_preparation(scan):
    prepared = intaglio.prepare_relief(scan, "smooth", device="cpu")
    pieces, grown = (prepared.complete(ReliefSettings(method=m), seed=1) for m in ("pieces", "propagation"))
    assert any("filled by pieces" in note for note in pieces.notes)
    assert any("grown in" in note for note in grown.notes)
    assert grown.confidence is None
    assert len(pieces.vertices) == len(grown.vertices)


# References


def dense(graph):
    return np.asarray(graph.todense(), float)


def test_averages_are_half_way_to_the_neighbours_mean(ground):
    rng = np.random.default_rng(0)
    use = rng.random(len(ground.foot)) < 0.8
    graph = ground.topology.graph
    matrix = dense(averaging(graph, use))
    np.testing.assert_allclose(matrix.sum(axis=1), 1, atol=1e-6)
    x = rng.normal(size=len(use))
    edges = dense(graph) * use * use[:, None]
    degree = edges.sum(axis=1)
    known = np.where(degree > 0, 0.5 * x + 0.5 * (edges @ x) / np.maximum(degree, 1), x)
    np.testing.assert_allclose(matrix @ x, known, atol=1e-6)
    twice = average(averaging(graph, use), x, 2)
    np.testing.assert_allclose(twice, matrix @ known, atol=1e-6)
    np.testing.assert_array_equal(twice[~use], x[~use])


def test_bands_add_up_and_hold_their_waves(ground):
    graph = averaging(ground.topology.graph, np.ones(len(ground.foot), bool))
    height = np.random.default_rng(0).normal(size=len(ground.foot))
    parts = bands(graph, height)
    np.testing.assert_allclose(sum(parts) + average(graph, height, BANDS[-1]), height, atol=1e-6)
    inner = (np.abs(ground.foot[:, :2] - SIDE / 2) < 10).all(axis=1)
    strength = [[float(np.std(b[inner])) for b in bands(graph, np.sin(2 * np.pi * ground.foot[:, 0] / n))] for n in (3.5, 8, 18)]
    # A wave is strongest in its own band.
    np.testing.assert_array_equal(np.argmax(strength, axis=1), [0, 1, 2])


def test_edges_are_counted_from_the_rim(ground):
    hops = edges_from(ground.topology.graph, ground.measured)
    assert (hops[ground.measured] == 0).all()
    graph = dense(ground.topology.graph) > 0
    for i in np.flatnonzero(~ground.measured):
        assert hops[i] == hops[graph[i]].min() + 1
    nowhere = edges_from(ground.topology.graph, np.zeros(len(hops), bool))
    assert (nowhere == len(hops)).all()


def all_wishes(ground, difference, known=None):
    """Return wishes for every edge of the targets."""
    topology = ground.topology
    first = np.repeat(np.arange(len(ground.foot)), np.diff(topology.offsets))
    use = ~ground.measured[first]
    first, other = first[use], topology.neighbors[use]
    known = np.ones(len(first), bool) if known is None else known(len(first))
    return Wishes(first, other, difference(first, other), known, np.ones(len(first)), np.zeros(len(first), bool))


def test_joining_reproduces_heights_whose_differences_are_asked_for(ground):
    height = np.random.default_rng(0).normal(size=len(ground.foot))
    wishes = all_wishes(ground, lambda i, j: height[j] - height[i])
    start = np.where(ground.measured, height, 0.0)
    joined = join(wishes, start, ~ground.measured)
    np.testing.assert_allclose(joined, height, atol=1e-6)
    np.testing.assert_array_equal(joined[ground.measured], height[ground.measured])
    # A part of the targets alone: the others keep what they have, and don't count.
    depth = edges_from(ground.topology.graph, ground.measured)
    active = ~ground.measured & (depth <= 2)
    some = join(wishes, start, active)
    np.testing.assert_allclose(some[active], height[active], atol=1e-6)
    assert (some[depth > 2] == 0).all()


@pytest.mark.parametrize("pull", [0.0, 0.3])
def test_joining_is_a_least_squares_fit(ground, pull):
    rng = np.random.default_rng(1)
    count = len(ground.foot)
    height = rng.normal(size=count)
    wishes = all_wishes(ground, lambda i, j: rng.normal(size=len(i)), lambda n: rng.random(n) < 0.7)
    wishes = replace(wishes, height=rng.normal(size=len(wishes.first)))
    joined = join(wishes, height, ~ground.measured, pull)
    # An edge whose source doesn't know pulls its ends together, by a fiftieth.
    root = np.sqrt(np.where(wishes.known, 1, 0.02))
    rows = np.zeros((len(root), count))
    rows[np.arange(len(root)), wishes.other] += root
    rows[np.arange(len(root)), wishes.first] -= root
    right = root * np.where(wishes.known, wishes.difference, 0) - rows @ np.where(ground.measured, height, 0)
    # What a source knows draws to its own height.
    draw = np.zeros_like(rows)
    draw[np.arange(len(root)), wishes.first] = np.sqrt(pull * wishes.known)
    rows = np.concatenate([rows, draw])
    right = np.concatenate([right, np.sqrt(pull * wishes.known) * wishes.height])
    best = np.linalg.lstsq(rows[:, ~ground.measured], right, rcond=None)[0]
    np.testing.assert_allclose(joined[~ground.measured], best, atol=1e-6)


def test_what_surrounds_is_carried_on_harmonically():
    ground = prepare_ground(without(sheet(bumps, side=22), (11, 11, 3)), "smooth")
    height = np.where(ground.measured, ground.height / ground.spacing, 0.0)
    around = Surroundings(ground, height)
    graph = dense(ground.topology.graph)
    mean = graph / graph.sum(axis=1, keepdims=True)
    target = ~ground.measured
    np.testing.assert_allclose(around.likeness[target], (mean @ around.likeness)[target], atol=1e-6)
    # Logarithms of the bands' energies, in measured standard deviations: slowly, from their definition.
    own = dense(averaging(ground.topology.graph, ground.measured))
    before, logs = height, []
    for times, spread in zip((4, 12, 48), (64, 64, 128), strict=True):
        smoother = before
        for _ in range(times):
            smoother = own @ smoother
        energy = (before - smoother) ** 2
        for _ in range(2 * spread):
            energy = own @ energy
        logs.append(np.log(energy + 1e-6)[ground.measured])
        before = smoother
    logs = np.stack(logs, axis=1)
    known = (logs - logs.mean(axis=0)) / (logs.std(axis=0) + 0.1)
    np.testing.assert_allclose(around.likeness[ground.measured], known, atol=1e-3)


def test_directions_are_those_of_the_slopes_in_any_frames():
    # Waves so long that a face's slope is that of the place it lies at.
    scan = without(sheet(lambda x, y: np.sin(2 * np.pi * (x + 0.5 * y) / 16), jitter=0), HOLE)
    ground = prepare_ground(scan, plane_base(), GroundOptions(extent="holes"))
    around = Surroundings(ground, np.where(ground.measured, ground.height / ground.spacing, 0.0))
    inner = (np.abs(ground.foot[:, :2] - SIDE / 2) < 10).all(axis=1)
    angle = np.arctan2(0.5, 1.0)
    off = np.abs(around.direction[inner] - [np.cos(2 * angle), np.sin(2 * angle)])
    # Beside the hole slopes are those of one side alone.
    assert off.mean() < 0.06
    assert off.max() < 0.25
    turn = np.random.default_rng(0).uniform(-np.pi, np.pi, len(ground.u))
    c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
    turned = replace(ground, u=c * ground.u + s * ground.v, v=c * ground.v - s * ground.u)
    known = np.stack([np.cos(2 * (angle - turn)), np.sin(2 * (angle - turn))], axis=1)
    off = np.abs(around.direction_in(turned) - known)[inner]
    assert off.mean() < 0.06
    assert off.max() < 0.3


def test_slopes_of_a_linear_height_are_its_own(ground):
    way = np.array([0.3, -0.2, 0.5])
    slope, area = slopes(ground.foot, ground.faces, ground.foot @ way)
    a, b, c = (ground.foot[ground.faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    np.testing.assert_allclose(area, np.linalg.norm(normal, axis=1))
    normal /= area[:, None]
    np.testing.assert_allclose(slope, way - (normal @ way)[:, None] * normal, atol=1e-9)


def test_contrast_is_raised_where_it_sank_and_only_there():
    scan = without(sheet(bumps, jitter=0), HOLE)
    ground = prepare_ground(scan, plane_base(), GroundOptions(extent="holes"))
    truth = bumps(*ground.foot.T[:2]) / ground.spacing
    around = Surroundings(ground, np.where(ground.measured, truth, 0.0))
    inner = np.hypot(*(ground.foot[:, :2] - SIDE / 2).T) < RADIUS / 2

    def strength(height):
        return float(np.std(height[inner]))

    flat = np.where(ground.measured, truth, 0.6 * truth)
    raised = around.raise_contrast(flat)
    np.testing.assert_array_equal(raised[ground.measured], truth[ground.measured])
    assert 0.8 < strength(raised) / strength(truth) < 1.2
    # What is as strong as expected is left alone but for chance, and what is stronger all the more.
    for factor, change in ((1.0, 0.15), (1.5, 0.05)):
        strong = np.where(ground.measured, truth, factor * truth)
        assert strength(around.raise_contrast(strong) - strong) < change * strength(strong)


def test_a_filling_over_a_plane_that_is_not_turned_is_copied_as_it_lies(scan):
    ground = prepare_ground(scan, plane_base(), GroundOptions(extent="holes"))
    filling = fill_coherently(ground, turning=False, seed=1)
    np.testing.assert_allclose(np.sin(filling.rotation[~ground.measured]), 0, atol=1e-4)
    np.testing.assert_allclose(filling.height[ground.measured], ground.height[ground.measured], atol=1e-12)
    assert filling.ground is ground
    assert filling.scale == 0
    assert 0.5 < filling.coherence <= 1


def test_weights_are_scaled_by_the_sources_own_spread(ground):
    search = FieldSearch(
        ground.measured, np.flatnonzero(~ground.measured), turning=True, mirrored=False, weights=Weights(), seed=0, device="cpu"
    )
    rng = np.random.default_rng(0)
    patches = rng.normal(size=(50, len(search._grid_weight), 4)) * [3.0, 0.5, 0.5, 1]
    patches[..., 3] = 1
    count = int(ground.measured.sum())
    surroundings = np.zeros((len(ground.foot), 4)), np.zeros((len(ground.foot), 2))
    search.take_level(None, patches.astype(np.float32), np.zeros(count, int), np.zeros(count), surroundings, 9.0)
    # Two unlike patches differ by twice their variance in height and in slope: each half makes 1/2 of it.
    assert search._terms.w_height == pytest.approx(0.5 / 9, rel=0.05)
    assert search._terms.w_slope == pytest.approx(0.5 / 0.5, rel=0.05)
    assert search._terms.reach == 9


# Quality, against what is simple


def off_truth(surface, truth):
    """Return the root mean square distance of the filled vertices from a height field."""
    x, y, z = surface.vertices[~surface.measured].T
    return float(np.sqrt(np.mean((z - truth(x, y)) ** 2)))


@pytest.mark.parametrize("seed", [0, 1])
def test_ripples_go_on_through_a_hole(seed):
    whole = sheet(ripples, side=56)
    scan = without(whole, (27.5, 27.5, 8))
    made = complete(scan, seed=seed)
    assert off_truth(made, ripples) < 0.45 * off_truth(without_relief(made), ripples)
    report = intaglio.assess_relief(made, whole, device="cpu")
    assert report.coherence > 0.8
    x, y, z = made.vertices[~made.measured].T
    middle = np.hypot(x - 27.5, y - 27.5) < 4
    assert 0.7 < z[middle].std() / ripples(x, y)[middle].std() < 1.4


@pytest.mark.parametrize("seed", [0, 1])
def test_relief_of_which_only_a_mirror_image_was_seen(seed):
    heights = rough(64)

    def truth(x, y):
        x, y = np.round(x).astype(int), np.round(y).astype(int)
        return heights[x, np.minimum(y, 56 - y)]

    scan = without(sheet(truth, side=57, jitter=0), (28, 14, 8))
    above = scan.vertices[:, 1] > 28.5
    made = complete(scan, base=plane_base(), seed=seed, exemplar=above, rotations=1, mirror=True)
    off = off_truth(made, truth)
    plain = off_truth(complete(scan, base=plane_base(), seed=seed, exemplar=above, rotations=1), truth)
    assert off < 0.45 * plain
    assert off < 0.45 * off_truth(without_relief(made), truth)


def test_a_hole_in_a_real_scan_is_filled_better_than_smoothly(real):
    case = next(c for c in CASES if c.name == "demosthenes_10")
    cut = cut_hole(intaglio.read_surface(real(f"meshes/{case.path}")), case.radius, case.seed)
    made = complete(cut.scan, seed=1)
    kept = made.file_vertex[made.measured]
    assert made.vertices[made.measured].tobytes() == cut.truth.vertices[kept].tobytes()
    assert not cut.removed[kept].any()
    report = intaglio.assess_relief(made, cut.truth, device="cpu")
    assert report.truth.distance_rms < report.truth.smooth_rms
    assert report.coherence > 0.75
    assert report.local_share > 0.5
