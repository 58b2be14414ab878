"""Correspondence fields on a surface: patches, rays, walks, what a match costs, sweeps, and what sources say about edges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from correspondence_reference import TURNS, UNFIT, NumPyField, Paths, mapped, match_cost, rotated, turned_patch

from intaglio import Surface
from intaglio.kernels import correspondence
from intaglio.kernels.correspondence import (
    ROTATIONS,
    Field,
    Patches,
    Steps,
    Terms,
    empty_field,
    patch_grid,
    patch_rays,
)
from intaglio.kernels.geodesics import trace, trace_rays
from intaglio.kernels.launch import launch, upload
from intaglio.mesh import grid_faces
from intaglio.relief.coherent.joining import ask_sources, coherence
from intaglio.relief.coherent.search import FieldSearch, Weights
from intaglio.relief.coherent.tables import SurfaceTables
from intaglio.relief.ground import GroundOptions, prepare_ground
from intaglio.scenes.patterns import plane_base

SIDE = 30
MIDDLE = (SIDE - 1) / 2
# Kernels work in single precision on lengths of up to some 20 spacings: a place is good to about 1e-5.
PLACE = 2e-5


def sheet(height, *, jitter=0.25, radius=5.0, seed=0):
    """A sheet of heights over a lattice of unit steps, shaken by up to ``jitter``, with a hole in its middle."""
    x, y = np.meshgrid(np.arange(float(SIDE)), np.arange(float(SIDE)))
    move = np.random.default_rng(seed).uniform(-jitter, jitter, (2, SIDE, SIDE))
    x, y = x + move[0], y + move[1]
    vertices = np.stack([x, y, height(x, y)], axis=-1).reshape(-1, 3)
    whole = Surface(vertices=vertices, faces=grid_faces(SIDE, SIDE)[:, ::-1])
    return whole.part(np.hypot(*(vertices[:, :2] - MIDDLE).T) >= radius)


def bumps(x, y):
    return 0.5 * np.sin(1.1 * x + 0.3 * y) + 0.4 * np.cos(0.4 * x - 0.9 * y)


def dome(x, y):
    return bumps(x, y) - 0.01 * ((x - MIDDLE) ** 2 + (y - MIDDLE) ** 2)


def with_turned_frames(ground, seed=0):
    """Return the ground with every frame turned by an angle of its own, and these angles."""
    angle = np.random.default_rng(seed).uniform(-np.pi, np.pi, len(ground.u))
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return replace(ground, u=c * ground.u + s * ground.v, v=c * ground.v - s * ground.u), angle


@pytest.fixture(scope="module")
def flat_ground():
    """Over the plane z = 0; frames lie along x and y."""
    return prepare_ground(sheet(bumps), plane_base(), GroundOptions(extent="holes"))


@pytest.fixture(scope="module")
def curved_ground():
    """Over the smoothed dome, its frames turned at random."""
    return with_turned_frames(prepare_ground(sheet(dome), "smooth"))[0]


@wp.kernel
def walk_kernel(
    start: int,
    steps: Steps,
    first: wp.array[wp.int32],
    way: wp.array[wp.vec2],
    # output
    at: wp.array[wp.int32],
    rest: wp.array[wp.vec2],
    turn: wp.array[wp.float32],
):
    i = start + wp.tid()
    p, left, turned = correspondence.walk(steps, first[i], way[i])
    at[i] = p
    rest[i] = left
    turn[i] = turned


@wp.kernel
def cost_kernel(
    start: int,
    patches: Patches,
    foot: wp.array[wp.vec3],
    target: wp.array[wp.int32],
    source: wp.array[wp.int32],
    angle: wp.array[wp.float32],
    mirror: wp.array[wp.int32],
    terms: Terms,
    # output
    cost: wp.array[wp.float32],
):
    i = start + wp.tid()
    cost[i] = correspondence.match_cost(patches, foot, target[i], source[i], angle[i], mirror[i], terms)


def walked(tables, first, way, device):
    """Return where the kernel's walks end: vertices, rests, frames' angles."""
    count = len(first)
    at = wp.zeros(count, dtype=wp.int32, device=device)
    rest, turn = wp.zeros(count, dtype=wp.vec2, device=device), wp.zeros(count, dtype=wp.float32, device=device)
    put = [tables.steps, upload(first, wp.int32, device), upload(way, wp.vec2, device)]
    launch(walk_kernel, count, inputs=put, outputs=[at, rest, turn], device=device)
    return at.numpy(), rest.numpy().astype(float), turn.numpy().astype(float)


def costs(look, target, source, angle, mirror, terms, device):
    """Return the kernel's costs of giving each target its source."""
    patches = Patches()
    kinds = {"values": wp.vec4, "likeness": wp.vec4, "direction": wp.vec2, "row": wp.int32, "turns": wp.int32}
    for name in ("values", "row", "row_turn", "turns", "weight", "likeness", "direction", "used"):
        setattr(patches, name, upload(look[name], kinds.get(name, wp.float32), device))
    out = wp.zeros(len(target), dtype=wp.float32, device=device)
    targets, sources, mirrors = (upload(a, wp.int32, device) for a in (target, source, mirror))
    put = [patches, upload(look["foot"], wp.vec3, device), targets, sources, upload(angle, wp.float32, device), mirrors, terms]
    launch(cost_kernel, len(target), inputs=put, outputs=[out], device=device)
    return out.numpy().astype(float)


def patches_alone():
    """Return terms by which the patches alone count."""
    terms = Terms()
    terms.w_height, terms.w_slope, terms.afloat, terms.missing, terms.reach = 1.3, 0.7, 1.0, 2.0, 1.0
    return terms


def grid_places():
    """Return a patch's grid points (G, 2), their rings one apart."""
    directions, point = patch_rays()
    places = np.zeros((int(point.max()) + 1, 2))
    for d, j in zip(*np.nonzero(point >= 0), strict=True):
        places[point[d, j]] = (j + 1) * directions[d].astype(float)
    return places


def sampled(function, gradient, places):
    """Return the patch (G, 4) of a function of the plane: value, derivatives outwards and around, known everywhere."""
    out = np.ones((len(places), 4))
    out[:, 0] = function(places)
    slope = gradient(places)
    way = places / np.maximum(np.linalg.norm(places, axis=1), 1e-12)[:, None]
    out[:, 1] = (slope * way).sum(axis=1)
    out[:, 2] = slope[:, 1] * way[:, 0] - slope[:, 0] * way[:, 1]
    return out


def two_patches(target, source):
    """Return the look of a target, vertex 0, and a source, vertex 1, as costs read it."""
    weight, turns = patch_grid()
    return {
        "values": np.stack([target, source]), "row": np.array([0, 1]), "row_turn": np.zeros(2), "turns": turns, "weight": weight,
        "likeness": np.zeros((2, 4)), "direction": np.zeros((2, 2)), "used": np.zeros(2), "foot": np.zeros((2, 3)),
    }  # fmt: skip


def pair_cost(target, source, angle, mirror, device):
    """Return the kernel's cost of a pair of patches, one turned by ``angle``."""
    one = np.ones(1, int)
    return costs(two_patches(target, source), 0 * one, one, [angle], mirror * one, patches_alone(), device)[0]


def test_a_patchs_weights_sum_to_one_and_fall_outwards():
    weight, turns = patch_grid()
    assert weight.sum() == pytest.approx(1, abs=1e-6)
    assert (weight > 0).all()
    radius = np.linalg.norm(grid_places(), axis=1)
    # What a point stands for is its share of its ring's area, times a bell of 2.5 rings.
    share = np.where(
        radius > 0, 2 * np.pi * radius / np.unique(radius.round(6), return_counts=True)[1][radius.round().astype(int)], np.pi / 4
    )
    np.testing.assert_allclose(weight, (w := share * np.exp(-0.5 * (radius / 2.5) ** 2)) / w.sum(), rtol=1e-5)
    assert turns.shape == (2 * ROTATIONS, len(weight))


def test_turning_there_and_back_and_mirroring_twice_change_nothing():
    _, turns = patch_grid()
    own = np.arange(turns.shape[1])
    assert (np.sort(turns, axis=1) == own).all()
    outer = np.linalg.norm(grid_places(), axis=1) > 2.5
    for q in range(ROTATIONS):
        back = turns[-q % ROTATIONS]
        same = back[turns[q]] == own
        # Rings of half the points are turned by whole points: between two of them it is the next one each way.
        assert same[outer].all()
        assert same.all() or q % 2
        mirrored = turns[ROTATIONS + q]
        assert (mirrored[mirrored] == own).all()


@pytest.mark.parametrize("mirror", [0, 1])
def test_turned_grid_points_fall_where_rays_put_them(mirror):
    places = grid_places()
    _, turns = patch_grid()
    for q in range(ROTATIONS):
        at = np.array([mapped(2 * np.pi * q / ROTATIONS, mirror, w) for w in places])
        off = np.linalg.norm(places[turns[q + ROTATIONS * mirror]] - at, axis=1)
        radius = np.linalg.norm(places, axis=1)
        # The two inner rings' points stand 30 degrees apart: odd turns miss by half of that.
        half = 2 * np.sin(np.radians(7.5)) * radius
        np.testing.assert_allclose(off, np.where((radius < 2.5) & (q % 2 == 1), half, 0), atol=1e-6)


def test_rays_hold_every_grid_point_once():
    directions, point = patch_rays()
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-6)
    weight, _ = patch_grid()
    assert (np.sort(point[point >= 0]) == np.arange(1, len(weight))).all()


def wavy(places):
    return np.sin(0.5 * places[:, 0] + 0.2) * np.cos(0.3 * places[:, 1] - 0.4) + 0.1 * places[:, 1]


def wavy_slope(places):
    a, b = 0.5 * places[:, 0] + 0.2, 0.3 * places[:, 1] - 0.4
    return np.stack([0.5 * np.cos(a) * np.cos(b), 0.1 - 0.3 * np.sin(a) * np.sin(b)], axis=1)


@pytest.mark.parametrize("mirror", [0, 1])
@pytest.mark.parametrize("q", [0, 2, 10, 22])
def test_a_patch_costs_nothing_at_its_own_angle_and_mirror_and_something_elsewhere(q, mirror, device):
    angle = 2 * np.pi * q / ROTATIONS
    places = grid_places()
    turn = np.stack([mapped(angle, mirror, e) for e in np.eye(2)], axis=1)
    source = sampled(wavy, wavy_slope, places)
    # The target looks like the source seen through the map: T(w) = S(A w), so that grad T = A' grad S.
    target = sampled(lambda w: wavy(w @ turn.T), lambda w: wavy_slope(w @ turn.T) @ turn, places)
    assert pair_cost(target, source, angle, mirror, device) == pytest.approx(0, abs=1e-6)
    # A height that is added counts for nothing, and so does a whole turn more or less.
    raised = target + [3.0, 0, 0, 0]
    for whole in (-2 * np.pi, 0, 4 * np.pi):
        # Squares of heights of 3 cancel to 1e-6 of 9.
        assert pair_cost(raised, source, angle + whole, mirror, device) == pytest.approx(0, abs=2e-5)
    assert pair_cost(target, source, angle + np.pi / 2, mirror, device) > 0.05
    assert pair_cost(target, source, angle, 1 - mirror, device) > 0.01


def test_what_a_source_does_not_know_costs_and_too_little_is_unfit(device):
    patch = sampled(wavy, wavy_slope, grid_places())
    weight, _ = patch_grid()
    holed = patch.copy()
    holed[40:] = 0
    lost = float(weight[40:].sum())
    assert 0.1 < lost < 0.5
    total = 1 / 1.05
    assert pair_cost(patch, holed, 0.0, 0, device) == pytest.approx(2.0 * lost * total, rel=1e-5)
    # A target that does not know it there does not miss it.
    assert pair_cost(holed, patch, 0.0, 0, device) == pytest.approx(0, abs=1e-6)
    holed[5:] = 0
    assert pair_cost(patch, holed, 0.0, 0, device) == UNFIT
    nothing = np.zeros_like(patch)
    assert pair_cost(nothing, patch, 0.0, 0, device) == 0


@pytest.mark.parametrize("afloat", [0.0, 1.0])
def test_costs_are_the_references(afloat, device):
    rng = np.random.default_rng(0)
    vertices, rows, pairs = 40, 25, 400
    weight, turns = patch_grid()
    look = {
        "values": np.concatenate([rng.normal(size=(rows, len(weight), 3)), rng.uniform(-0.4, 1, (rows, len(weight), 1))], axis=2),
        "row": rng.integers(0, rows, vertices), "row_turn": rng.uniform(-4, 4, vertices), "turns": turns, "weight": weight,
        "likeness": rng.normal(size=(vertices, 4)), "direction": rng.normal(size=(vertices, 2)),
        "used": rng.uniform(0, 2, vertices), "foot": rng.uniform(-8, 8, (vertices, 3)),
    }  # fmt: skip
    look["values"][..., 3] = np.maximum(look["values"][..., 3], 0)
    # The first row knows little: as a source it is unfit, which is the one cost that is not a sum.
    look["values"][0, 8:, 3] = 0
    terms = patches_alone()
    terms.locality, terms.reach, terms.likeness, terms.use, terms.direction = 0.3, 9.0, 0.2, 0.4, 0.15
    terms.afloat, terms.upright = afloat, 0.25
    target, source = rng.integers(0, vertices, (2, pairs))
    mirror, angle = rng.integers(0, 2, pairs), rng.uniform(-7, 7, pairs)
    # Beside the middle between two of the patch's turns single precision and double agree on which is meant.
    turn = (angle + look["row_turn"][source]) * TURNS / (2 * np.pi)
    sure = np.abs(turn % 1 - 0.5) > 1e-3
    found = costs(look, target, source, angle, mirror, terms, device)
    known = [match_cost(look, *one, terms) for one in zip(target, source, angle, mirror, strict=True)]
    assert 0 < (found > UNFIT / 2).sum() < pairs / 2
    np.testing.assert_allclose(found[sure], np.array(known)[sure], rtol=1e-5)


def test_walks_on_a_flat_lattice_end_where_arithmetic_says(flat_ground, device):
    ground, angle = with_turned_frames(flat_ground)
    tables = SurfaceTables(ground, device)
    rng = np.random.default_rng(1)
    inner = np.flatnonzero(np.abs(ground.foot[:, :2] - MIDDLE).max(axis=1) < 8)
    first = rng.choice(inner, 300)
    way = rng.uniform(-4, 4, (300, 2))
    at, rest, turn = walked(tables, first, way, device)

    def goal(vertex, offset):
        return tables.foot[vertex] + (offset[:, :1] * ground.u[vertex] + offset[:, 1:] * ground.v[vertex])

    np.testing.assert_allclose(goal(at, rest), goal(first, way), atol=PLACE)
    # The frames' angles add up whichever way was taken, since the surface is flat.
    np.testing.assert_allclose(np.exp(1j * turn), np.exp(1j * (angle[at] - angle[first])), atol=1e-5)
    # It ends at the vertex that is nearest, or at one whose neighbours are all further: on a shaken lattice mostly the nearest.
    nearest = np.argmin(np.linalg.norm(tables.foot[:, None] - goal(first, way), axis=2), axis=0)
    assert (at == nearest).mean() > 0.95


def test_a_place_carried_over_an_edge_and_back_is_where_it_was(curved_ground, device):
    tables = SurfaceTables(curved_ground, device)
    reverse = {(i, j): e for e, (i, j) in enumerate(zip(tables.first, tables.other, strict=True))}
    back = np.array([reverse[j, i] for i, j in zip(tables.first, tables.other, strict=True)])
    step, turn = tables.steps.step.numpy().astype(float), tables.steps.turn.numpy().astype(float)
    # The frames' turns are the same both ways to the bit, but for their sign, and edges are as long as they are.
    assert (turn == -turn[back]).all()
    length = np.linalg.norm(tables.foot[tables.other] - tables.foot[tables.first], axis=1)
    np.testing.assert_allclose(np.linalg.norm(step, axis=1), length, rtol=1e-6)
    # On a curved surface an edge looks a little different from its two ends: by the angle between their normals.
    there = -np.array([rotated(-a, w) for a, w in zip(turn, step, strict=True)])
    bend = np.arccos(
        np.clip(np.einsum("ij,ij->i", curved_ground.normal[tables.first], curved_ground.normal[tables.other]), -1, 1)
    )
    assert (np.linalg.norm(there - step[back], axis=1) <= length * bend + 1e-5).all()
    at, rest, turned = walked(tables, tables.first, step, device)
    assert (at == tables.other).all()
    np.testing.assert_allclose(rest, 0, atol=1e-6)
    np.testing.assert_allclose(turned, turn, atol=1e-6)
    at, rest, turned = walked(tables, tables.other, there, device)
    assert (at == tables.first).mean() == 1
    assert (np.linalg.norm(rest, axis=1) <= length * bend + 1e-5).all()
    np.testing.assert_allclose(turned, -turn, atol=1e-6)


def test_walks_are_the_references(curved_ground, device):
    tables = SurfaceTables(curved_ground, device)
    paths = Paths.of(tables)
    rng = np.random.default_rng(2)
    first = rng.integers(0, len(tables.foot), 300)
    # Some lead beyond the border, and end there.
    way = rng.uniform(-8, 8, (300, 2))
    at, rest, turn = walked(tables, first, way, device)
    known = [paths.walk(i, w) for i, w in zip(first, way, strict=True)]
    assert (at == [k[0] for k in known]).all()
    np.testing.assert_allclose(rest, [k[1] for k in known], atol=PLACE)
    np.testing.assert_allclose(turn, [k[2] for k in known], atol=PLACE)
    assert (np.linalg.norm(rest, axis=1) > 1).any()


def test_rays_are_straight_on_a_plane_and_end_at_its_border(flat_ground, device):
    ground, _ = with_turned_frames(flat_ground)
    tables = SurfaceTables(ground, device)
    vertices = np.arange(0, len(ground.foot), 7)
    step = 1.7
    located = tables.locate(vertices, step)
    face, weight = located.face.numpy(), located.weight.numpy().astype(float)
    weight = np.concatenate([weight, 1 - weight.sum(axis=2, keepdims=True)], axis=2)
    found = np.einsum("igk,igkc->igc", weight, tables.foot[ground.faces[face]])
    places = step * grid_places()
    u, v = ground.u[vertices, None], ground.v[vertices, None]
    goal = tables.foot[vertices, None] + places[None, :, :1] * u + places[None, :, 1:] * v
    assert (np.linalg.norm(found - goal, axis=2)[face >= 0] < 10 * PLACE).all()
    low, high = tables.foot.min(axis=0), tables.foot.max(axis=0)
    # The border is shaken by half a unit: so near to it either is right.
    shaken = 0.5 / ground.spacing + 0.01
    inside = ((goal[..., :2] > low[:2] + shaken) & (goal[..., :2] < high[:2] - shaken)).all(axis=2)
    outside = ((goal[..., :2] < low[:2]) | (goal[..., :2] > high[:2])).any(axis=2)
    # A line between two points inside stays inside.
    inside &= inside[:, :1]
    assert (face[inside] >= 0).all()
    assert (face[outside] < 0).all()
    assert outside.any()


def test_rays_end_where_single_walks_do_on_a_curved_surface(curved_ground, device):
    tables = SurfaceTables(curved_ground, device)
    vertices = np.arange(0, len(curved_ground.foot), 11)
    frames = tables.foot[vertices], curved_ground.u[vertices], curved_ground.v[vertices]
    first = curved_ground.topology.incident[curved_ground.topology.face_offsets[vertices]]
    directions, point = patch_rays()
    mesh = tables.mesh
    rays = trace_rays(*frames, first, directions, point, 1.3, mesh, device)
    single = trace(*frames, first, 1.3 * grid_places(), mesh.points, mesh.faces, mesh.across, device)
    known = single[0].numpy() >= 0

    def places(face, weight):
        b = weight.numpy().astype(float)
        b = np.concatenate([b, 1 - b.sum(axis=2, keepdims=True)], axis=2)
        return np.einsum("igk,igkc->igc", b, tables.foot[curved_ground.faces[face.numpy()]])

    # Within rounding of the border one may end and the other not.
    assert ((rays[0].numpy() >= 0) == known).mean() > 0.999
    known &= rays[0].numpy() >= 0
    assert 0.5 < known.mean() < 1
    assert np.linalg.norm(places(*rays) - places(*single), axis=2)[known].max() < 10 * PLACE


def test_patches_hold_height_slopes_and_the_least_confidence(flat_ground, device):
    ground, _ = with_turned_frames(flat_ground)
    tables = SurfaceTables(ground, device)
    slope = np.array([0.3, -0.2, 0.0])
    confidence = np.random.default_rng(0).uniform(0.2, 1, len(ground.foot))
    confidence[::50] = 0
    vertices = np.flatnonzero(np.abs(ground.foot[:, :2] - MIDDLE).max(axis=1) < 9)[::5]
    located = tables.locate(vertices, 1.0)
    value = tables.read(located, tables.foot @ slope, confidence)
    places = grid_places()
    way = places[:, :1] * ground.u[vertices, None] + places[:, 1:] * ground.v[vertices, None]
    out = way / np.maximum(np.linalg.norm(way, axis=2, keepdims=True), 1e-12)
    least = confidence[ground.faces[located.face.numpy()]].min(axis=2)
    np.testing.assert_allclose(value[..., 3], least, atol=1e-6)
    known = least > 0
    assert (value[~known] == 0).all()
    assert (~known).any()
    np.testing.assert_allclose(value[..., 0][known], ((tables.foot[vertices, None] + way) @ slope)[known], atol=1e-4)
    known[:, 0] = False
    np.testing.assert_allclose(value[..., 1][known], (out @ slope)[known], atol=1e-4)
    around = np.cross([0.0, 0, 1], out)
    np.testing.assert_allclose(value[..., 2][known], (around @ slope)[known], atol=1e-4)
    # Read in parts or at once is the same.
    np.testing.assert_array_equal(tables.patches(vertices, 1.0, tables.foot @ slope, confidence), value)


def searching(ground, device, *, seed=3, **options):
    """Return tables, a search over them, and what its costs are computed from, as NumPy holds it."""
    tables = SurfaceTables(ground, device)
    graph = ground.topology.graph
    inner = ground.measured & ~(graph @ (~ground.measured).astype(float) > 0)
    targets = np.flatnonzero(~ground.measured)
    rng = np.random.default_rng(seed)
    height = np.where(ground.measured, ground.height / ground.spacing, 0.0)
    search = FieldSearch(
        inner, targets, **{"turning": True, "mirrored": True, **options}, weights=Weights(smallest=6), seed=seed, device=device
    )
    chosen, stands, turn = tables.thinned(search.sources, 2.0)
    sources = tables.patches(chosen, 2.0, height, ground.measured.astype(float))
    around = rng.normal(size=(len(height), 4)), rng.normal(size=(len(height), 2))
    search.take_level(tables, sources, stands, turn, around, 9.0)
    sure = np.where(ground.measured, 1.0, 0.4)
    search.take_targets(tables.patches(targets, 2.0, height, sure), ~ground.measured, rng.uniform(0, 1, len(height)))
    look = {name: np.array(getattr(search._compared, name).numpy()) for name in two_patches(0, 0) if name != "foot"}
    look = {name: a.astype(float) if a.dtype.kind == "f" else a for name, a in look.items()}
    return tables, search, {**look, "foot": tables.foot}


def implied(paths, field, active, allowed, i):
    """Return what each neighbour with a source says about i, and the places that count for coherence, None for none."""
    steps = [e for e in paths.around(i) if active[paths.neighbors[e]] and field.place[paths.neighbors[e]] >= 0]
    said = [(*paths.carried(field, i, e), field.mirror[paths.neighbors[e]]) for e in steps]
    return [one if allowed[one[0]] and np.linalg.norm(one[1]) < 1 else None for one in said]


def full_cost(paths, look, said, i, p, angle, mirror, terms):
    """Return a candidate's cost with coherence."""
    cost = match_cost(look, i, p, angle, mirror, terms)
    if said:
        agree = sum(one is not None and np.linalg.norm(paths.foot[one[0]] - paths.foot[p]) < 1.05 for one in said)
        cost += terms.coherence * (1 - agree / len(said))
    return cost


def test_a_sweep_gives_every_target_the_cost_and_choice_of_the_reference(curved_ground, device):
    tables, search, look = searching(curved_ground, device)
    paths = Paths.of(tables)
    allowed = np.zeros(len(tables.foot), bool)
    allowed[search.sources] = True
    active = ~curved_ground.measured
    for _ in range(4):
        search.sweep(8.0, 3.0)
    for explore in (True, False):
        before = NumPyField.of(search.field)
        search.sweep(8.0, 3.0, explore=explore)
        after = NumPyField.of(search.field)
        changed = 0
        for i in search.targets:
            same = all(np.array_equal(getattr(after, name)[i], getattr(before, name)[i]) for name in vars(after))
            said = implied(paths, before, active, allowed, i)
            own = (before.place[i], before.offset[i], before.angle[i], before.mirror[i])
            candidates = [own, *(one for one in said if one is not None)]
            known = [full_cost(paths, look, said, i, p, way, flip, search._terms) for p, _, way, flip in candidates]
            if not same:
                changed += 1
                cost = full_cost(paths, look, said, i, after.place[i], after.angle[i], after.mirror[i], search._terms)
                assert after.cost[i] == pytest.approx(cost, rel=1e-4)
                # What neighbours say was looked at, and without exploring nothing else.
                assert after.cost[i] <= min(known) * (1 + 1e-4)
                if not explore:
                    assert after.cost[i] == pytest.approx(min(known), rel=1e-4)
                    chosen = candidates[int(np.argmin(known))]
                    if np.sort(known)[1:].min() > min(known) * (1 + 1e-3):
                        assert after.place[i] == chosen[0]
                        np.testing.assert_allclose(after.offset[i], chosen[1], atol=PLACE)
                        np.testing.assert_allclose(np.exp(1j * after.angle[i]), np.exp(1j * chosen[2]), atol=1e-4)
                        assert after.mirror[i] == chosen[3]
        # Six in ten targets look in a sweep, and not all of them find another source or cost.
        assert 0.1 < changed / len(search.targets) < 0.8
    assert after.mirror[search.targets].any()
    assert allowed[after.place[search.targets]].all()
    assert (after.place[~active] == -1).all()


def test_without_turning_or_mirroring_maps_are_the_frames_alone(flat_ground, device):
    ground, _ = with_turned_frames(flat_ground)
    # Where frames lie along x and y, places are copied as they lie; a place that is carried keeps to that.
    _, search, _ = searching(flat_ground, device, turning=False, mirrored=False)
    for _ in range(6):
        search.sweep(8.0, 3.0)
    field = NumPyField.of(search.field)
    np.testing.assert_allclose(field.angle[search.targets], 0, atol=1e-5)
    assert not field.mirror.any()
    _, search, _ = searching(ground, device, turning=True, mirrored=False)
    for _ in range(6):
        search.sweep(8.0, 3.0)
    field = NumPyField.of(search.field)
    assert not field.mirror.any()
    # With frames turned at random all angles appear.
    assert np.histogram(field.angle[search.targets] % (2 * np.pi), 6, (0, 2 * np.pi))[0].min() > 0
    assert (field.cost[search.targets] < UNFIT).all()


def test_sweeps_lower_the_cost(curved_ground, device):
    _, search, _ = searching(curved_ground, device)
    search.sweep(8.0, 3.0)
    mean = []
    for _ in range(12):
        mean.append(float(NumPyField.of(search.field).cost[search.targets].mean()))
        search.sweep(8.0, 3.0)
    assert mean[-1] < 0.6 * mean[0]


def test_targets_without_neighbours_or_luck_have_no_source(flat_ground, device):
    _, search, _ = searching(flat_ground, device)
    # No field yet, and nothing is drawn at random: there is nobody to ask.
    search.sweep(8.0, 3.0, explore=False)
    assert (search.place == -1).all()
    search.sweep(8.0, 3.0)
    assert (search.place[search.targets] >= 0).all()


def shifted_field(tables, ground, shift, device):
    """Return the field that gives every target the vertex that lies ``shift`` from it, all in one piece."""
    targets = np.flatnonzero(~ground.measured)
    goal = tables.foot[targets] + [*shift, 0.0]
    off = np.linalg.norm(tables.foot[:, None] - goal, axis=2)
    place = np.full(len(tables.foot), -1)
    place[targets] = off.argmin(axis=0)
    assert off.min(axis=0).max() < 1e-6
    field = empty_field(len(place), device)
    field.place = upload(place, wp.int32, device)
    return field, place


@pytest.fixture(scope="module")
def lattice_ground():
    """Over a plane, on a lattice of unit steps that the targets continue; frames lie along x and y."""
    ground = prepare_ground(sheet(bumps, jitter=0, radius=4.3), plane_base(), GroundOptions(extent="holes"))
    assert ground.regular
    return ground


def test_one_piece_says_its_own_differences_and_is_coherent(lattice_ground, device):
    ground = lattice_ground
    tables = SurfaceTables(ground, device)
    field, place = shifted_field(tables, ground, (-9.0, 1.0), device)
    height = ground.height / ground.spacing
    wishes = ask_sources(tables, field, height, ground.measured)
    at = ground.foot[wishes.other] + [-9.0, 1.0, 0]
    assert wishes.known.all()
    np.testing.assert_allclose(wishes.difference, bumps(*at.T[:2]) - height[place[wishes.first]], atol=1e-5)
    np.testing.assert_allclose(wishes.height, height[place[wishes.first]], atol=1e-5)
    inner = ~ground.measured[wishes.other]
    assert wishes.agrees[inner].all()
    assert not wishes.agrees[~inner].any()
    assert coherence(wishes, ground.measured) == 1
    # Edges are those of the targets, each from both its ends.
    edges = set(zip(wishes.first.tolist(), wishes.other.tolist(), strict=True))
    faces = ground.faces.tolist()
    assert edges == {(a, b) for f in faces for a in f for b in f if a != b and not ground.measured[a]}


def height_at(ground, foot, height, p, at):
    """Return the height at a point beside vertex p, and whether all corners there are measured."""
    best = (-np.inf, None, None)
    for face in ground.faces[(ground.faces == p).any(axis=1)]:
        corner = foot[face]
        n = np.cross(corner[1] - corner[0], corner[2] - corner[0])
        b = np.array([np.cross(corner[(k + 2) % 3] - corner[(k + 1) % 3], at - corner[(k + 1) % 3]) @ n for k in range(3)]) / (
            n @ n
        )
        if b.min() > best[0]:
            b0 = np.maximum(b, 0)
            best = b.min(), b0 @ height[face] / b0.sum(), ground.measured[face].all()
    return best[1:]


def test_wishes_of_any_field_are_the_references(curved_ground, device):
    ground = curved_ground
    tables, search, _ = searching(ground, device)
    for _ in range(3):
        search.sweep(8.0, 3.0)
    height = np.where(ground.measured, ground.height / ground.spacing, 0.0)
    wishes = ask_sources(tables, search.field, height, ground.measured)
    paths, field = Paths.of(tables), NumPyField.of(search.field)
    entries = np.flatnonzero(~ground.measured[tables.first])
    assert (wishes.first == tables.first[entries]).all()
    known_count = 0
    for k, e in enumerate(entries[::3]):
        k = 3 * k
        i, j = tables.first[e], tables.other[e]
        p, offset = field.place[i], field.offset[i]
        q, rest, _ = paths.walk(p, offset + mapped(field.angle[i], field.mirror[i], paths.step[e]))
        places = [tables.foot[r] + w[0] * ground.u[r] + w[1] * ground.v[r] for r, w in ((p, offset), (q, rest))]
        (here, sure), (there, also) = (
            height_at(ground, tables.foot, height, r, at) for r, at in zip((p, q), places, strict=True)
        )
        assert wishes.height[k] == pytest.approx(here, abs=1e-4)
        reached = np.linalg.norm(rest) < 1
        assert wishes.known[k] == bool(sure and also and reached)
        if wishes.known[k]:
            known_count += 1
            # A place that falls on an edge of two faces may be read in either; heights agree there.
            assert wishes.difference[k] == pytest.approx(there - here, abs=1e-4)
        agrees = reached and field.place[j] >= 0 and np.linalg.norm(tables.foot[q] - tables.foot[field.place[j]]) < 1.5
        assert wishes.agrees[k] == bool(agrees)
    assert 0.5 < known_count / len(entries[::3]) < 1 or wishes.known.all()
    assert 0 < wishes.agrees.mean() < 1


def test_an_empty_field_wishes_nothing(lattice_ground, device):
    tables = SurfaceTables(lattice_ground, device)
    field: Field = empty_field(len(tables.foot), device)
    wishes = ask_sources(tables, field, lattice_ground.height, lattice_ground.measured)
    assert not wishes.known.any()
    assert not wishes.agrees.any()
    assert (wishes.difference == 0).all()


def test_small_pieces_are_taken_over_by_their_neighbours(lattice_ground, device):
    ground = lattice_ground
    tables, search, _ = searching(ground, device)
    field, place = shifted_field(tables, ground, (-9.0, 1.0), device)
    off = np.linalg.norm(ground.foot[:, :2] - MIDDLE, axis=1)
    island = np.flatnonzero(~ground.measured)[np.argsort(off[~ground.measured], kind="stable")[:4]]
    scattered = place.copy()
    scattered[island] = search.sources[[3, 60, 120, 170]]
    field.place = upload(scattered, wp.int32, device)
    search.field = field

    def ask():
        return ask_sources(tables, search.field, ground.height / ground.spacing, ground.measured)

    before = coherence(ask(), ground.measured)
    search.give_up_small_pieces(ask(), 20)
    assert coherence(ask(), ground.measured) == 1 > before
    np.testing.assert_array_equal(search.place, place)


def test_where_all_pieces_are_small_none_is_given_up(lattice_ground, device):
    tables, search, _ = searching(lattice_ground, device)
    search.sweep(8.0, 3.0)
    before = search.place.copy()
    search.give_up_small_pieces(
        replace(
            ask_sources(tables, search.field, lattice_ground.height, lattice_ground.measured),
            agrees=np.zeros((~lattice_ground.measured[tables.first]).sum(), bool),
        ),
        20,
    )
    np.testing.assert_array_equal(search.place, before)


def test_thinned_patches_stand_near_and_at_their_angle(flat_ground):
    ground, angle = with_turned_frames(flat_ground)
    tables = SurfaceTables(ground, "cpu")
    vertices = np.flatnonzero(ground.measured)
    chosen, stands, turn = tables.thinned(vertices, 4.0)
    assert len(chosen) < 0.6 * len(vertices)
    own = np.isin(vertices, chosen)
    np.testing.assert_array_equal(chosen[stands[own]], vertices[own])
    # One in every cell of half a step, on a flat sheet a square of 2: it is no further than the corners are.
    apart = np.linalg.norm(tables.foot[vertices][:, None] - tables.foot[chosen], axis=2)
    np.testing.assert_array_equal(stands, apart.argmin(axis=1))
    assert apart.min(axis=1).max() < 2 * np.sqrt(2)
    np.testing.assert_allclose(np.exp(1j * turn), np.exp(1j * (angle[vertices] - angle[chosen[stands]])), atol=1e-9)
    # At a fine step every vertex stands for itself.
    chosen, stands, turn = tables.thinned(vertices, 0.2)
    np.testing.assert_array_equal(chosen[stands], vertices)
    np.testing.assert_allclose(turn, 0, atol=1e-12)


def test_patches_of_a_thin_sheets_sides_do_not_stand_for_one_another(flat_ground):
    # The same sheet twice, back to back and a tenth of a spacing apart.
    ground = flat_ground
    both = replace(
        ground,
        foot=np.concatenate([ground.foot, ground.foot - [0, 0, 0.1]]),
        normal=np.concatenate([ground.normal, -ground.normal]),
        u=np.tile(ground.u, (2, 1)),
        v=np.concatenate([ground.v, -ground.v]),
    )
    tables = SurfaceTables(ground, "cpu")
    # Both sides lie in the same cells.
    tables._ground, tables.foot = both, both.foot / ground.spacing + [0, 0, 0.5]
    vertices = np.arange(len(both.foot))
    chosen, stands, _ = tables.thinned(vertices, 4.0)
    facing = np.einsum("ij,ij->i", both.normal[vertices], both.normal[chosen[stands]])
    assert (facing > 0.5).all()


def test_turned_patches_match_geometry():
    # The reference itself: what it calls turned is the patch of the turned function.
    places, (_, turns) = grid_places(), patch_grid()
    source = sampled(wavy, wavy_slope, places)
    for q, mirror in ((4, 0), (6, 1)):
        turn = np.stack([mapped(2 * np.pi * q / TURNS, mirror, e) for e in np.eye(2)], axis=1)
        seen = sampled(lambda w, turn=turn: wavy(w @ turn.T), lambda w, turn=turn: wavy_slope(w @ turn.T) @ turn, places)
        np.testing.assert_allclose(turned_patch(source, turns, 2 * np.pi * q / TURNS, mirror), seen, atol=1e-6)
