"""What is to be completed: the extent of the base, and target points over it at the scan's own sampling density."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, cKDTree

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.mesh import Base, Cylinder, Plane, Sphere, directed_edges, edge_lengths, perpendicular, unit

Extent = str | Sequence[float] | None

# More targets than this are refused: a spacing mistyped by a factor of a thousand would fill the memory.
_MOST_TARGETS = 4_000_000


@dataclass(frozen=True)
class Region:
    """The region to complete.

    Attributes
    ----------
    candidates : (M, 3) float64 array
        Possible target points on the base.
    inside : callable or None
        ``inside(points) -> bool`` array; None for a closed base.
    only_holes : bool
        Only regions enclosed by the scan.
    regular : bool
        The candidates continue the scan's own lattice.
    note : str
        What was chosen, for the user.
    """

    candidates: Array
    inside: Callable[[Array], Array] | None
    only_holes: bool
    regular: bool
    note: str


def sampling_distance(feet: Array, faces: Array, median: bool = False) -> tuple[float, str]:
    """Return the distance between samples to be used for targets, and how it was found.

    3DIM 2005, section 4: the minimum edge length bounds the highest frequency that the capture holds, so targets at that
    distance don't alias. A single tiny edge (a scanner's glitch, a decimator's sliver) would demand millions of them:
    the 5 % quantile of the edge lengths on the base stands for the minimum, and at least half the median. With ``median`` it is
    the median: where the scan's own triangles are of many sizes, targets much finer than most of them would copy single
    vertices side by side, which is rougher than the scan.
    """
    length = edge_lengths(feet, faces)
    if not length.all():
        length = length[length > 0]
    if len(length) == 0:
        raise InputError("all edges of the scan have length zero on the base: no sampling distance can be found")
    low, middle, least = _order_statistics(length)
    if median:
        spacing, rule = middle, "the median"
    else:
        spacing = max(low, 0.5 * middle)
        rule = "the 5 % quantile" if low >= 0.5 * middle else "half the median"
    return spacing, f"spacing {spacing:.6g}: {rule} of the scan's edge lengths (minimum {least:.6g}, median {middle:.6g})"


def _order_statistics(values: Array) -> tuple[float, float, float]:
    """Return the 5 % quantile, the median and the least of values, as NumPy computes them; the values are put in another order.

    What is looked for is put in its place once, and nothing is copied.
    """
    last = len(values) - 1
    at = 0.05 * last
    low = int(at)
    values.partition(sorted({low, min(low + 1, last), last // 2, (last + 1) // 2}))
    quantile = float(np.quantile(values[low : low + 2], at - low)) if low < last else float(values[low])
    return quantile, float(np.mean(values[last // 2 : (last + 1) // 2 + 1])), float(values[: low + 1].min())


def region_to_complete(
    base: Base, feet: Array, faces: Array, spacing: float, extent: Extent, continue_lattice: bool = True
) -> Region:
    """Lay out target points over what is to be completed.

    Parameters
    ----------
    base : Base
        The base.
    feet, faces : (N, 3), (F, 3) arrays
        The scan's points on the base and its triangles.
    spacing : float
        Distance between targets, in the input's unit.
    extent : str, sequence of float or None
        ``"whole"``: the whole sphere; the full turn of the cylinder over the scanned length; on a plane the scan's
        rectangle. ``"rectangle"``: on a plane, the scan's own rectangle without its holes. ``"holes"``: only what the scan
        encloses. ``(low, high)`` for a cylinder: that length along the axis; ``(u0, u1, v0, v1)`` for a plane: that
        rectangle, in the plane's chart; ``(degrees,)`` for a sphere: a cap of that half angle about the scan's middle.
        None: ``"whole"``.
    continue_lattice : bool
        Where the scan's samples form a lattice, let targets continue it, whatever ``spacing``.

    Raises
    ------
    InputError
        For an extent that the base does not have, or more than four million targets.
    """
    if isinstance(extent, str) and extent not in ("whole", "rectangle", "holes"):
        raise InputError(f"unknown extent {extent!r}; known: 'whole', 'rectangle', 'holes', or numbers (see help)")
    if isinstance(base, Sphere):
        return _sphere(base, feet, spacing, extent)
    if isinstance(base, Cylinder):
        return _cylinder(base, feet, faces, spacing, extent, continue_lattice)
    if isinstance(base, Plane):
        return _plane(base, feet, faces, spacing, extent, continue_lattice)
    raise InputError(f"extents of a {base.kind} are not known")


def _sphere(base: Sphere, feet: Array, spacing: float, extent: Extent) -> Region:
    if extent == "rectangle":
        raise InputError("extent 'rectangle' goes with a plane; a sphere has 'whole', 'holes' or (degrees,), a cap")
    direction = unit(feet - base.center)
    middle = unit(direction.mean(axis=0)) if np.linalg.norm(direction.mean(axis=0)) > 1e-6 else np.array([0.0, 0.0, 1.0])
    if extent is None or extent == "whole":
        return Region(_cap(base, middle, np.pi, spacing, extent), None, False, False, "extent: the whole sphere")
    if extent == "holes":
        reach = float(np.arccos(np.clip(direction @ middle, -1, 1).min()))
        return Region(_cap(base, middle, reach, spacing, extent), None, True, False, "extent: holes in the scan")
    (degrees,) = _numbers(extent, 1, "a sphere's extent is (degrees,), the half angle of a cap about the scan's middle")
    if not 0 < degrees < 180:
        raise InputError(f"a cap's half angle is between 0 and 180 degrees, not {degrees}")
    least = np.cos(np.radians(degrees))

    def inside(points: Array) -> Array:
        return unit(points - base.center) @ middle > least

    cap = _cap(base, middle, float(np.radians(degrees)), spacing, extent)
    return Region(cap, inside, False, False, f"extent: a cap of {degrees:g} degrees about the scan's middle")


def _cap(base: Sphere, middle: Array, half_angle: float, spacing: float, extent: Extent) -> Array:
    """Return a nearly triangular lattice of step ``spacing`` within ``half_angle`` (radians) of ``middle``."""
    _checked(2 * np.pi * base.radius**2 * (1 - np.cos(half_angle)), spacing, extent)
    if half_angle < np.pi / 6:
        # A flat lattice rolled on along great circles; 30 degrees out it is squeezed by 5 %.
        reach = base.radius * half_angle
        flat = _hexagonal(-reach, reach, -reach, reach, spacing, wrap=False)
        length = np.linalg.norm(flat, axis=1)
        flat, length = flat[length <= reach], length[length <= reach]
        e1 = perpendicular(middle)
        along = unit(flat) @ np.stack([e1, np.cross(middle, e1)])
        angle = (length / base.radius)[:, None]
        return base.center + base.radius * (np.cos(angle) * middle + np.sin(angle) * along)
    direction = _geodesic_lattice(max(2, round(1.107 * base.radius / (0.9 * spacing))))
    return base.center + base.radius * direction[direction @ middle >= np.cos(half_angle)]


def _geodesic_lattice(frequency: int) -> Array:
    """Return 10 frequency^2 + 2 directions: a triangular lattice on the faces of an icosahedron, about 1.1 / frequency apart."""
    golden = (1 + 5**0.5) / 2
    corners = np.array([(s * a, t * b, 0.0) for a, b in ((1.0, golden),) for s in (1, -1) for t in (1, -1)])
    corners = unit(np.concatenate([np.roll(corners, k, axis=1) for k in range(3)]))
    faces = ConvexHull(corners).simplices
    i, j = np.meshgrid(np.arange(frequency + 1), np.arange(frequency + 1), indexing="ij")
    i, j = i[i + j <= frequency], j[i + j <= frequency]
    # Great-circle interpolation keeps the steps nearly equal from a face's corner to its middle.
    weight = np.stack([i, j, frequency - i - j], axis=1) / frequency
    edge = np.arccos(corners[faces[0, 0]] @ corners[faces[0, 1]])
    points = unit(np.einsum("pk,fkc->fpc", np.sin(weight * edge), corners[faces]).reshape(-1, 3))
    # Faces share their edges' points.
    _, first = np.unique(np.round(points * frequency * 4).astype(np.int64), axis=0, return_index=True)
    return points[np.sort(first)]


def _cylinder(base: Cylinder, feet: Array, faces: Array, spacing: float, extent: Extent, continue_lattice: bool) -> Region:
    chart = base.chart(feet)
    lattice = scan_lattice(chart, faces) if continue_lattice else None
    columns = None if lattice is None else _upright(lattice)
    # A few vertices that stick out of a ragged rim don't stretch the whole turn; a lattice has straight rims.
    ends = [0.01, 0.99] if columns is None else [0.0, 1.0]
    low, high = (float(v) for v in np.quantile(chart[:, 1], ends))
    if extent == "rectangle":
        raise InputError("extent 'rectangle' goes with a plane; a cylinder has 'whole' (the full turn) or 'holes'")
    if extent is not None and not isinstance(extent, str):
        low, high = _numbers(extent, 2, "a cylinder's extent is (low, high) along its axis")
    turn = 2 * np.pi * base.radius
    _checked(turn * max(high - low, spacing), spacing, extent)
    if lattice is not None and columns is not None:
        grid = _close_the_turn(chart, lattice, columns, turn, low, high)
    else:
        grid = _hexagonal(0.0, turn, low, high, spacing, wrap=True)
    margin = 0.25 * spacing

    def inside(points: Array) -> Array:
        height = base.chart(points)[:, 1]
        return (height > low - margin) & (height < high + margin)

    only = extent == "holes"
    note = "extent: holes in the scan" if only else f"extent: the full turn, {low:.6g} to {high:.6g} along the axis"
    if columns is not None:
        note += "; targets continue the scan's lattice"
    return Region(base.from_chart(grid), inside, only, columns is not None, note)


def _plane(base: Plane, feet: Array, faces: Array, spacing: float, extent: Extent, continue_lattice: bool) -> Region:
    chart = base.chart(feet)
    low, high = chart.min(axis=0), chart.max(axis=0)
    if extent is not None and not isinstance(extent, str):
        u0, u1, v0, v1 = _numbers(extent, 4, "a plane's extent is (u0, u1, v0, v1) in its chart")
        low, high = np.array([u0, v0]), np.array([u1, v1])
    _checked(float(np.prod(np.maximum(high - low, spacing))), spacing, extent)
    lattice = scan_lattice(chart, faces) if continue_lattice else None
    if lattice is not None:
        grid = _lattice_points(lattice, low, high)
    else:
        grid = _hexagonal(low[0], high[0], low[1], high[1], spacing, wrap=False)
    margin = 0.25 * spacing

    def inside(points: Array) -> Array:
        q = base.chart(points)
        return ((q > low - margin) & (q < high + margin)).all(axis=1)

    only = extent == "holes"
    size = f"{high[0] - low[0]:.6g} x {high[1] - low[1]:.6g}"
    note = "extent: holes in the scan" if only else f"extent: a rectangle {size} on the plane"
    if lattice is not None:
        note += "; targets continue the scan's lattice"
    return Region(base.from_chart(grid), inside, only, lattice is not None, note)


def scan_lattice(chart: Array, faces: Array) -> tuple[Array, Array] | None:
    """Find the lattice that the scan's samples form in the chart, if they do.

    Targets that continue it are in phase with the samples (3DIM 2005, section 4).

    Returns
    -------
    (origin, steps) or None
        ``origin`` (2,) and ``steps`` (2, 2), one lattice step a row; None where fewer than 95 % of the samples lie within
        a tenth of a step of a lattice point.
    """
    e = directed_edges(faces)
    step = chart[e[:, 1]] - chart[e[:, 0]]
    length = np.linalg.norm(step, axis=1)
    typical = np.median(length)
    # Steps that wrap around a cylinder's cut are no steps.
    step = step[(length < 3 * typical) & (length > 1e-3 * typical)]
    step = np.where((step[:, :1] < -1e-9 * typical) | ((abs(step[:, :1]) <= 1e-9 * typical) & (step[:, 1:] < 0)), -step, step)
    if len(step) < 30:
        return None
    bins = np.round(step / (0.1 * typical)).astype(int)
    cells, counts = np.unique(bins, axis=0, return_counts=True)
    common = cells[counts > 0.1 * len(step)] * 0.1 * typical
    common = common[np.argsort(np.linalg.norm(common, axis=1), kind="stable")]
    if len(common) < 2:
        return None
    first = common[0]
    second = next((c for c in common[1:] if abs(_cross(first, c)) > 0.3 * np.linalg.norm(first) * np.linalg.norm(c)), None)
    if second is None:
        return None
    steps = np.array([first, second])
    origin = chart[cKDTree(chart).query(chart.mean(axis=0))[1]]
    reach = 4 * typical
    size = float(np.ptp(chart, axis=0).max())
    while True:
        # Integer positions are safe only near the origin at first: the fit's reach grows as its steps get exact.
        near = chart[np.linalg.norm(chart - origin, axis=1) < reach]
        index = np.round((near - origin) @ np.linalg.inv(steps))
        solution, _, rank, _ = np.linalg.lstsq(np.column_stack([index, np.ones(len(near))]), near, rcond=None)
        if rank < 3 or abs(np.linalg.det(solution[:2])) < 0.1 * typical**2:
            return None
        steps, origin = solution[:2], solution[2]
        if reach > 2 * size:
            break
        reach *= 1.5
    position = (chart - origin) @ np.linalg.inv(steps)
    off = np.abs(position - np.round(position)).max(axis=1)
    return (origin, steps) if np.mean(off < 0.1) >= 0.95 else None


def _lattice_points(lattice: tuple[Array, Array], low: Array, high: Array) -> Array:
    origin, steps = lattice
    corners = np.array([[low[0], low[1]], [high[0], low[1]], [low[0], high[1]], [high[0], high[1]]])
    at = (corners - origin) @ np.linalg.inv(steps)
    i0, j0 = np.floor(at.min(axis=0)).astype(int)
    i1, j1 = np.ceil(at.max(axis=0)).astype(int)
    ij = np.stack(np.meshgrid(np.arange(i0, i1 + 1), np.arange(j0, j1 + 1), indexing="ij"), -1).reshape(-1, 2)
    points = origin + ij @ steps
    slack = 0.1 * np.linalg.norm(steps, axis=1).min()
    return points[((points > low - slack) & (points < high + slack)).all(axis=1)]


def _upright(lattice: tuple[Array, Array]) -> tuple[float, float] | None:
    """Return (column step, row step) where the lattice's steps lie along arc and axis."""
    steps = lattice[1]
    for a, b in ((steps[0], steps[1]), (steps[1], steps[0])):
        if abs(a[1]) < 0.02 * abs(a[0]) and abs(b[0]) < 0.02 * abs(b[1]):
            return abs(float(a[0])), abs(float(b[1]))
    return None


def _close_the_turn(
    chart: Array, lattice: tuple[Array, Array], steps: tuple[float, float], turn: float, low: float, high: float
) -> Array:
    """Lattice points all around: the columns over the unseen arc are stretched so that a whole number of them fits."""
    column, row = steps
    arc = np.sort(chart[:, 0])
    gaps = np.diff(np.concatenate([arc, arc[:1] + turn]))
    last = int(np.argmax(gaps))
    start, gap = arc[last], gaps[last]
    count = max(1, round(gap / column))
    behind = start + np.arange(1, count) * (gap / count)
    seen = start + gap + np.arange(0, max(1, round((turn - gap) / column)) + 1) * column
    heights = lattice[0][1] + row * np.arange(np.ceil((low - lattice[0][1]) / row - 0.1), (high - lattice[0][1]) / row + 0.1)
    columns = np.concatenate([behind, seen[seen < start + turn + 0.5 * column]])
    return np.stack(np.meshgrid(columns, heights, indexing="ij"), -1).reshape(-1, 2)


def _hexagonal(u0: float, u1: float, v0: float, v1: float, spacing: float, *, wrap: bool) -> Array:
    rows = max(2, round((v1 - v0) / (spacing * np.sqrt(0.75))) + 1)
    columns = max(3 if wrap else 2, round((u1 - u0) / spacing) + (0 if wrap else 1))
    v = np.linspace(v0, v1, rows)
    step = (u1 - u0) / (columns if wrap else columns - 1)
    u = u0 + step * np.arange(columns)
    shift = 0.5 * step * (np.arange(rows) % 2)
    grid = np.stack(np.broadcast_arrays(u[None, :] + shift[:, None], v[:, None]), -1).reshape(-1, 2)
    if wrap:
        return grid
    # Every second row is half a step short on the left and long on the right: its ends are put on the edge.
    ends = np.stack([np.full(rows, u0), v], axis=1)[1::2]
    return np.concatenate([grid[grid[:, 0] <= u1 + 1e-9 * (u1 - u0)], ends, ends + (u1 - u0, 0.0)])


def _checked(area: float, spacing: float, extent: Extent) -> None:
    """Refuse an area of too many targets. For holes alone most of it is the scan itself: more is then let pass."""
    most = 10 * _MOST_TARGETS if isinstance(extent, str) and extent == "holes" else _MOST_TARGETS
    count = area / spacing**2 / np.sqrt(0.75)
    if not count <= most:
        raise InputError(f"spacing {spacing:.4g} would make {count:.3g} targets; give a larger spacing or a smaller extent")


def _numbers(extent: str | Sequence[float], count: int, meaning: str) -> list[float]:
    try:
        values = [float(v) for v in np.atleast_1d(np.asarray(extent, np.float64))]
    except (TypeError, ValueError):
        values = []
    if len(values) != count or not np.isfinite(values).all():
        raise InputError(f"{meaning}: {count} finite numbers, not {extent!r}")
    if any(a >= b for a, b in zip(values[::2], values[1::2], strict=False)):
        raise InputError(f"{meaning}, each low before its high: {extent!r}")
    return values


def _cross(a: Array, b: Array) -> float:
    return float(a[0] * b[1] - a[1] * b[0])
