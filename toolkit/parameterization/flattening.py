"""Low-distortion parameterization of a surface over the unit square (Yamauchi et al. 2005, section 3)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array, diags_array

from intaglio.arrays import Array, Progress
from intaglio.checks import checked_arguments
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.kernels.distortion import MIPS, STRETCH, Distortion
from intaglio.mesh import Surface, adjacency, border_loops, used_vertices
from intaglio.parameterization.atlas import atlas
from intaglio.parameterization.charts import (
    Chart,
    doubled_areas,
    doubled_texture_areas,
    flat_edges,
    invert_matrices,
)
from intaglio.parameterization.embedding import convex_border, embed, embed_without_flips, intrinsic_weights, relax_stretch
from intaglio.parameterization.minimize import minimize_distortion
from intaglio.parameterization.options import Options
from intaglio.parameterization.result import Parameterization, measure_parameterization
from intaglio.parameterization.seams import cut_open, edge_graph, joining_seam, longest_way, path_between
from intaglio.parameterization.topology_check import Kind, classify_topology

# Powers by which the largest stretch is approached, from the mean square on.
_POWERS = (4.0, 8.0, 16.0, 32.0)

# Weights of the triangle shape term, from one minimisation to the next; that of Yamauchi et al. is infinite.
_STRICTNESS = (1.0, 30.0, 1000.0)

# The shape term starts at this multiple of the threshold, so that the threshold itself holds with a finite weight.
_SHAPE_FROM = 1.1

# A hole is bridged rather than joined by a seam if its border is shorter than this share of the longest border, and of the root
# of the surface's area.
_SMALL_HOLE = 0.5

# Share of the weight of a surface triangle of the same area that a bridge over a hole has.
_BRIDGE = 1e-3

# A minimisation ends when a step lowers the energy by less than this share.
_TOLERANCE = 1e-4

# Rings of neighbours over which stretch is averaged to find where another seam helps most, as a share of the root of the
# number of vertices: seams into every small cavity help less than one across a broad bulge.
_RINGS = 0.25

# Free space around a free chart in [0, 1]^2, on each side.
MARGIN = 0.005

_MOST_SEAMS = 12


@checked_arguments
def parameterize(
    surface: Surface,
    energy: str = "stretch",
    *,
    boundary: str = "free",
    view: ArrayLike | None = None,
    importance: float = 1.5,
    shape_threshold: float = 0.0,
    max_stretch: float | None = None,
    conformal: float = 0.5,
    iterations: int = 100,
    device: str | None = None,
    progress: Progress | None = None,
) -> Parameterization:
    """Lay a surface flat over [0, 1]^2, as one chart of low distortion if its topology allows.

    A disk is kept whole. A surface of genus 0 that is closed or has several borders is cut open along short seams; small holes
    are bridged during the computation instead. Other surfaces get several charts from xatlas. ``notes`` says what was done.

    Parameters
    ----------
    surface : Surface
        Every triangle must have area, and the faces join as a surface, as `read_surface` leaves them. Vertices that no face uses
        get no place.
    energy : {"stretch", "stretch-max", "mips", "intrinsic", "mean-value"}, optional
        What is minimised: the L2 geometric stretch; the largest stretch, approached by high powers; the conformal MIPS
        energy; the linear intrinsic mixture (with a fixed boundary; it may flip triangles, which are counted); or only the
        linear mean value embedding with which the others start. Default "stretch", as published.
    boundary : {"free", "circle", "square"}, optional
        Free borders move to lower the energy and never cross themselves; fixed ones are laid out by chord length.
    view : (3,) sequence, optional
        Direction from the object towards the eye for the view that matters most: what faces it gets more of the texture, and
        seams keep to the back. Default None: all directions matter the same.
    importance : float, optional
        The k of equation 2, above 1: the nearer to 1, the more the view counts; 1.01 to 2 is useful.
    shape_threshold : float, optional
        The α of section 3: least ratio of height to longest side of a triangle in the texture, 0 to 0.5. 0 leaves the term out;
        0.05 to 0.15 is useful. Triangles that are thinner than that on the surface have nine tenths of their own ratio as
        threshold.
    max_stretch : float, optional
        More seams are cut, at most 12, each to the place of highest stretch, while the L2 stretch is above this; at least
        1.01. Default None: only those that the topology requires.
    conformal : float, optional
        Share of the conformal energy in the intrinsic one, 0 to 1; the rest is authalic.
    iterations : int, optional
        The most Newton steps of a minimisation.
    device : str, optional
        ``"cpu"``, ``"cuda:0"``. Default None: CUDA if there is one.
    progress : callable, optional
        Called with the steps done and the most steps.

    Returns
    -------
    Parameterization
        Texture positions, the faces on them, and how much they are stretched.

    Raises
    ------
    InputError
        For triangles without area, faces that don't join as a surface, and options out of range.

    See Also
    --------
    intaglio.combine_photographs : Fills the texture.

    References
    ----------
    Yamauchi et al., "Textures Revisited", The Visual Computer 21, 2005, section 3, equation 2. The visual importance there is
    1 / (<N, V> + k) with V in the direction of sight; here ``view`` points the other way, so the sign is the opposite. Sander
    et al., "Texture Mapping Progressive Meshes", SIGGRAPH 2001, section 3. Hormann & Greiner, "MIPS: An Efficient Global
    Parametrization Method", 2000. Desbrun, Meyer & Alliez, "Intrinsic Parameterizations of Surface Meshes", Eurographics
    2002, section 3.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> square = intaglio.Surface(vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]))
    >>> uv = intaglio.parameterize(square, device="cpu")
    >>> round(uv.l2_stretch, 6), uv.flips
    (1.0, 0)
    """
    used = used_vertices(surface.faces, len(surface.vertices))
    if used.any() and not used.all():
        part = parameterize(
            surface.part(used),
            energy,
            boundary=boundary,
            view=view,
            importance=importance,
            shape_threshold=shape_threshold,
            max_stretch=max_stretch,
            conformal=conformal,
            iterations=iterations,
            device=device,
            progress=progress,
        )
        return replace(part, vertex=np.flatnonzero(used)[part.vertex].astype(np.int32))
    options = Options(surface, energy, boundary, view, importance, shape_threshold, max_stretch, conformal, iterations)
    chosen = device_or_error(device)
    kind = classify_topology(surface)
    if kind.pieces > 1 or kind.genus > 0:
        uv, faces, vertex = atlas(surface.vertices, surface.faces)
        note = f"{kind.describe()}: no single chart can hold it; charts by xatlas, without energy, boundary and view"
        found = measure_parameterization(surface, uv, faces, vertex, (note,))
        return _add_note(found, f"{found.charts} charts")
    notes: list[str] = []
    bridged = _bridge_holes(surface, kind, notes)
    cost = (
        None
        if options.seam_cost is None
        else np.pad(options.seam_cost, (0, len(bridged.vertices) - len(surface.vertices)), mode="mean")
    )
    graph = edge_graph(bridged.vertices, bridged.faces, cost)
    seam = _first_seam(bridged, graph, notes)
    best = _flatten_chart(options, bridged, seam, tuple(notes), chosen, progress)
    if max_stretch is None:
        return best
    seams = 0
    while best.l2_stretch > max_stretch and seams < _MOST_SEAMS:
        longer = _lengthen_seam(bridged, graph, seam, best)
        if len(longer) == len(seam):
            break
        try:
            found = _flatten_chart(options, bridged, longer, tuple(notes), chosen, progress)
        except InputError:
            # The chart found before is valid; a seam after which there is none is not cut.
            break
        seam, seams = longer, seams + 1
        # A seam that does not help by itself may help together with the next one.
        if found.l2_stretch < best.l2_stretch:
            best = found
    return _add_note(best, f"{seams} seams cut to lower the stretch to {best.l2_stretch:.3f}") if seams else best


@dataclass(frozen=True)
class _Bridged:
    """A mesh whose small holes are closed by fans of faces, each about a vertex of its own."""

    vertices: Array
    faces: Array
    loops: list[Array]


def _bridge_holes(surface: Surface, kind: Kind, notes: list[str]) -> _Bridged:
    """Return the mesh with small holes closed, and its other border loops."""
    points, fans = [surface.vertices], [surface.faces]
    loops = kind.loops[:1]
    for loop in kind.loops[1:]:
        if not _is_small(surface, loop, kind.loops[0]):
            loops.append(loop)
            continue
        hub = sum(len(p) for p in points)
        points.append(surface.vertices[loop].mean(axis=0, keepdims=True))
        fans.append(np.stack([np.roll(loop, -1), loop, np.full(len(loop), hub)], axis=1).astype(np.int32))
    if len(fans) > 1:
        notes.append(f"{len(fans) - 1} small holes bridged while laying flat; they stay holes")
    return _Bridged(np.concatenate(points), np.concatenate(fans), loops)


def _first_seam(bridged: _Bridged, graph: csr_array, notes: list[str]) -> Array:
    """Return the seam (S, 2) that makes a surface of genus 0 a disk."""
    if not bridged.loops:
        seam = longest_way(graph)
        notes.append(f"closed surface: cut open along a seam of {len(seam)} edges")
        return seam
    seam = joining_seam(graph, bridged.loops)
    if len(seam):
        notes.append(f"{len(bridged.loops)} borders joined by seams of {len(seam)} edges")
    return seam


def _is_small(surface: Surface, loop: Array, longest: Array) -> bool:
    size = np.sqrt(doubled_areas(surface.vertices, surface.faces).sum() / 2)
    return bool(_length(surface, loop) < _SMALL_HOLE * min(size, _length(surface, longest)))


def _length(surface: Surface, loop: Array) -> float:
    return float(np.linalg.norm(surface.vertices[loop] - surface.vertices[np.roll(loop, -1)], axis=1).sum())


def _flatten_chart(
    options: Options, bridged: _Bridged, seam: Array, notes: tuple[str, ...], device: str, progress: Progress | None
) -> Parameterization:
    """Cut the surface along ``seam``, lay it flat, and remove the bridges over holes."""
    surface = options.surface
    faces, origin = cut_open(bridged.faces, len(bridged.vertices), seam)
    vertices = bridged.vertices[origin]
    # Scaled to size 1, without survey coordinates.
    size = float(np.sqrt(doubled_areas(bridged.vertices, bridged.faces).sum()))
    chart = Chart((vertices - vertices.mean(axis=0)) / size, faces, _outer_loop(faces))
    weight = np.concatenate([options.importance, np.full(len(faces) - len(surface.faces), _BRIDGE)])
    uv = _flatten(options, chart, weight, device, progress)
    own = faces[: len(surface.faces)]
    used = np.zeros(len(origin), bool)
    used[own] = True
    own = (np.cumsum(used) - 1).astype(np.int32)[own]
    uv, origin = uv[used], origin[used]
    if options.boundary == "free" and options.energy not in ("intrinsic", "mean-value"):
        uv = _fit_to_square(uv)
    return measure_parameterization(surface, uv, own, origin, notes)


def _outer_loop(faces: Array) -> Array:
    loops = border_loops(faces)
    if len(loops) != 1:
        raise InputError(
            f"the surface has {len(loops)} borders after cutting, where a disk has one: it is pinched; "
            "separate parts that touch in single vertices"
        )
    return loops[0].astype(np.int64)


def _flatten(options: Options, chart: Chart, weight: Array, device: str, progress: Progress | None) -> Array:
    """Return texture positions (N, 2) of a disk."""
    fixed = "circle" if options.boundary == "free" else options.boundary
    if options.energy == "mean-value":
        return embed_without_flips(chart, fixed)[0]
    if options.energy == "intrinsic":
        uv = embed(intrinsic_weights(chart, options.conformal), chart, convex_border(chart, fixed))
        flat = int((doubled_texture_areas(uv, chart.faces) == 0).sum())
        if flat or not np.isfinite(uv).all():
            raise InputError(f"{flat} triangles would be flat on a {fixed}; use boundary='circle', or another energy")
        return uv
    area = _safe_areas(chart)
    share = area / area.sum()
    weight = weight * share
    weight /= weight.sum()
    uv = relax_stretch(chart, fixed, weight)
    # At the optimum of the energy, the area in the texture is that on the surface.
    scale = np.sqrt(area.sum() / doubled_texture_areas(uv, chart.faces).sum())
    uv = uv * scale
    corner = flat_edges(chart.vertices, chart.faces)
    rest = invert_matrices(corner)
    longest = np.max(
        [
            corner[:, 0, 0],
            np.hypot(corner[:, 0, 1], corner[:, 1, 1]),
            np.hypot(corner[:, 0, 1] - corner[:, 0, 0], corner[:, 1, 1]),
        ],
        axis=0,
    )
    least = np.minimum(options.shape_threshold, 0.9 * area / longest**2)
    rounds = [(2.0, strictness) for strictness in (_STRICTNESS if options.shape_threshold > 0 else _STRICTNESS[:1])]
    if options.energy == "stretch-max":
        rounds += [(power, rounds[-1][1]) for power in _POWERS]
    for number, (power, strictness) in enumerate(rounds):
        distortion = Distortion(
            chart.faces,
            rest,
            weight,
            share,
            _SHAPE_FROM * least,
            kind=MIPS if options.energy == "mips" else STRETCH,
            power=power,
            strictness=strictness,
            device=device,
        )
        uv, _ = minimize_distortion(
            chart,
            distortion,
            uv,
            free=options.boundary == "free",
            iterations=options.iterations,
            tolerance=_TOLERANCE,
            progress=_in_round(progress, number, len(rounds)),
        )
    return uv if options.boundary == "free" else uv / scale


def _in_round(progress: Progress | None, number: int, rounds: int) -> Progress | None:
    """Return a callable that reports one of several minimisations as part of all of them."""
    if progress is None:
        return None
    report = progress
    return lambda done, most: report(number * most + done, rounds * most)


def _safe_areas(chart: Chart) -> Array:
    """Return twice the areas of the triangles; bridges over holes, which may have none, get a small one."""
    area = doubled_areas(chart.vertices, chart.faces)
    return np.maximum(area, 1e-6 * float(area.mean()))


def _fit_to_square(uv: Array) -> Array:
    """Return the chart turned to fit the smallest square, in [MARGIN, 1 - MARGIN]^2."""
    best, fitted = np.inf, uv
    for angle in np.radians(np.arange(90)):
        c, s = np.cos(angle), np.sin(angle)
        turned = uv @ np.array([[c, s], [-s, c]])
        side = float(np.ptp(turned, axis=0).max())
        if side < best * (1 - 1e-9):
            best, fitted = side, turned
    middle = (fitted.min(axis=0) + fitted.max(axis=0)) / 2
    return 0.5 + (fitted - middle) * (1 - 2 * MARGIN) / best


def _lengthen_seam(bridged: _Bridged, graph: csr_array, seam: Array, found: Parameterization) -> Array:
    """Return the seam, extended to the place of highest stretch, which is averaged over neighbourhoods of some rings."""
    count = len(bridged.vertices)
    own = bridged.faces[: len(found.faces)]
    area = doubled_areas(bridged.vertices, own)
    corners = own.reshape(-1)
    weight = np.bincount(corners, np.repeat(area, 3), count)
    stretch = np.bincount(corners, np.repeat(area * found.face_stretch**2, 3), count)
    around = adjacency(bridged.faces, count) + diags_array(np.ones(count))
    for _ in range(round(_RINGS * count**0.5)):
        weight, stretch = around @ weight, around @ stretch
    open_now = np.unique(np.concatenate([seam.reshape(-1), *[loop.astype(np.int64) for loop in bridged.loops]]))
    mean = stretch / np.maximum(weight, 1e-300)
    mean[open_now] = 0
    return np.concatenate([seam, path_between(graph, int(np.argmax(mean)), open_now)])


def _add_note(found: Parameterization, note: str) -> Parameterization:
    return replace(found, notes=(*found.notes, note))
