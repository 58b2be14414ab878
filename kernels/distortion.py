"""Distortion of maps from triangles in space to the plane: energies, gradients and positive semidefinite Hessians.

J maps a triangle, laid flat, to the texture plane; its singular values are s1 >= s2 > 0, and 1/s2 is how far the surface is
stretched at most when the texture is put on it.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch, upload

wp.set_module_options({"enable_backward": False})

mat22 = wp.types.matrix(shape=(2, 2), dtype=wp.float64)
mat23 = wp.types.matrix(shape=(2, 3), dtype=wp.float64)
vec2 = wp.types.vector(length=2, dtype=wp.float64)
vec4 = wp.types.vector(length=4, dtype=wp.float64)

STRETCH = 0
MIPS = 1


@wp.struct
class MappedTriangles:
    """Triangles of a map: their corners, rest shapes and weights, and the energy's kind and parameters; see `Distortion`."""

    faces: wp.array2d[wp.int32]
    rest: wp.array[mat22]
    weight: wp.array[wp.float64]
    share: wp.array[wp.float64]
    least: wp.array[wp.float64]
    kind: int
    power: wp.float64
    strictness: wp.float64


# Below this relative difference of the singular values a quotient of differences is replaced by its limit.
_EQUAL = wp.constant(wp.float64(1.0e-7))


@wp.func
def jacobian(uv: wp.array[vec2], a: int, b: int, c: int, rest: mat22) -> mat22:
    """J = (u_b - u_a, u_c - u_a) rest, where ``rest`` inverts the edges of the triangle laid flat."""
    p = uv[b] - uv[a]
    q = uv[c] - uv[a]
    return mat22(p[0], q[0], p[1], q[1]) * rest


@wp.func
def shape_excess(uv: wp.array[vec2], a: int, b: int, c: int, least: wp.float64) -> vec4:
    """Return least * side^2 / (2 area) - 1, above 0 where the height over the longest side is below ``least`` times that side.

    It comes with side^2, twice the area, and the number of the corner before the longest side.
    """
    p = uv[b] - uv[a]
    q = uv[c] - uv[a]
    r = uv[c] - uv[b]
    twice = p[0] * q[1] - p[1] * q[0]
    longest = wp.dot(p, p)
    corner = wp.float64(0.0)
    if wp.dot(r, r) > longest:
        longest = wp.dot(r, r)
        corner = wp.float64(1.0)
    if wp.dot(q, q) > longest:
        longest = wp.dot(q, q)
        corner = wp.float64(2.0)
    return vec4(least * longest / twice - wp.float64(1.0), longest, twice, corner)


@wp.kernel
def energy_kernel(
    start: int,
    uv: wp.array[vec2],
    mesh: MappedTriangles,
    # output
    energy: wp.array[wp.float64],
):
    """Write the energy of each triangle; infinite where it is flipped.

    Stretch: weight/p (s1^-p + s2^-p) + share s1 s2, which for p = 2 is the squared L2 stretch of Sander et al. (2001) and the
    texture's area. MIPS: weight (s1/s2 + s2/s1). Both: + strictness share max(0, shape_excess)^2.
    """
    t = start + wp.tid()
    a = mesh.faces[t, 0]
    b = mesh.faces[t, 1]
    c = mesh.faces[t, 2]
    j = jacobian(uv, a, b, c, mesh.rest[t])
    det = j[0, 0] * j[1, 1] - j[0, 1] * j[1, 0]
    value = wp.float64(wp.inf)
    shape = shape_excess(uv, a, b, c, mesh.least[t])
    if det > wp.float64(0.0):
        norm = j[0, 0] * j[0, 0] + j[0, 1] * j[0, 1] + j[1, 0] * j[1, 0] + j[1, 1] * j[1, 1]
        if mesh.kind == 1:
            value = mesh.weight[t] * norm / det
        elif mesh.power == wp.float64(2.0):
            value = mesh.weight[t] * wp.float64(0.5) * norm / (det * det) + mesh.share[t] * det
        else:
            root = wp.sqrt(wp.max(norm * norm - wp.float64(4.0) * det * det, wp.float64(0.0)))
            s1 = wp.sqrt(wp.float64(0.5) * (norm + root))
            s2 = det / s1
            value = mesh.weight[t] / mesh.power * (wp.pow(s1, -mesh.power) + wp.pow(s2, -mesh.power)) + mesh.share[t] * det
        if shape[0] > wp.float64(0.0):
            value += mesh.strictness * mesh.share[t] * shape[0] * shape[0]
    energy[t] = value


@wp.func
def scatter(out: wp.array2d[wp.float64], t: int, value: mat22, factor: wp.float64, g: mat23):
    """Add factor (value g) (value g)^T to the 6 x 6 Hessian in row ``t``; the columns of g belong to the corners."""
    d = value * g
    for p in range(3):
        for x in range(2):
            for q in range(3):
                for y in range(2):
                    out[t, (p * 2 + x) * 6 + q * 2 + y] += factor * d[x, p] * d[y, q]


@wp.kernel
def derivative_kernel(
    start: int,
    uv: wp.array[vec2],
    mesh: MappedTriangles,
    # output
    gradient: wp.array2d[wp.float64],
    hessian: wp.array2d[wp.float64],
):
    """Write gradient (6) and projected Hessian (36) of each triangle's energy by its corners, u and v alternating.

    The Hessian by J has the eigenvectors of Smith, de Goes and Kim, Analytic eigensystems for isotropic distortion energies
    (2019): two scalings, a twist and a flip, in the frames of J's singular vectors. Negative eigenvalues are set to zero.
    """
    t = start + wp.tid()
    a = mesh.faces[t, 0]
    b = mesh.faces[t, 1]
    c = mesh.faces[t, 2]
    m = mesh.rest[t]
    j = jacobian(uv, a, b, c, m)
    # J = R(alpha) diag(s1, s2) R(beta)^T: alpha + beta and alpha - beta are the angles of (f, g) and (e, h) below.
    e = wp.float64(0.5) * (j[0, 0] + j[1, 1])
    f = wp.float64(0.5) * (j[0, 0] - j[1, 1])
    g = wp.float64(0.5) * (j[1, 0] + j[0, 1])
    h = wp.float64(0.5) * (j[1, 0] - j[0, 1])
    q = wp.sqrt(e * e + h * h)
    r = wp.sqrt(f * f + g * g)
    s1 = q + r
    det = j[0, 0] * j[1, 1] - j[0, 1] * j[1, 0]
    s2 = det / s1
    both = wp.atan2(g, f)
    turn = wp.atan2(h, e)
    alpha = wp.float64(0.5) * (both + turn)
    beta = wp.float64(0.5) * (both - turn)
    ca = wp.cos(alpha)
    sa = wp.sin(alpha)
    cb = wp.cos(beta)
    sb = wp.sin(beta)
    left = mat22(ca, -sa, sa, ca)
    right = mat22(cb, sb, -sb, cb)

    w = mesh.weight[t]
    one = wp.float64(1.0)
    f1 = wp.float64(0.0)
    f2 = wp.float64(0.0)
    f11 = wp.float64(0.0)
    f22 = wp.float64(0.0)
    f12 = wp.float64(0.0)
    if mesh.kind == 1:
        f1 = w * (one / s2 - s2 / (s1 * s1))
        f2 = w * (one / s1 - s1 / (s2 * s2))
        f11 = w * wp.float64(2.0) * s2 / (s1 * s1 * s1)
        f22 = w * wp.float64(2.0) * s1 / (s2 * s2 * s2)
        f12 = -w * (one / (s1 * s1) + one / (s2 * s2))
    else:
        p1 = w * wp.pow(s1, -mesh.power - one)
        p2 = w * wp.pow(s2, -mesh.power - one)
        f1 = -p1 + mesh.share[t] * s2
        f2 = -p2 + mesh.share[t] * s1
        f11 = (mesh.power + one) * p1 / s1
        f22 = (mesh.power + one) * p2 / s2
        f12 = mesh.share[t]
    twist = (f1 + f2) / (s1 + s2)
    flip = f11 - f12
    if s1 - s2 > _EQUAL * s1:
        flip = (f1 - f2) / (s1 - s2)

    # dJ by the corners: columns of rest^T for b and c, and minus their sum for a.
    basis = mat23(-m[0, 0] - m[1, 0], m[0, 0], m[1, 0], -m[0, 1] - m[1, 1], m[0, 1], m[1, 1])
    first = left * mat22(one, wp.float64(0.0), wp.float64(0.0), wp.float64(0.0)) * right
    second = left * mat22(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), one) * right
    slope = (f1 * first + f2 * second) * basis
    for p in range(3):
        gradient[t, 2 * p] = slope[0, p]
        gradient[t, 2 * p + 1] = slope[1, p]
    for k in range(36):
        hessian[t, k] = wp.float64(0.0)
    mean = wp.float64(0.5) * (f11 + f22)
    spread = wp.sqrt(wp.float64(0.25) * (f11 - f22) * (f11 - f22) + f12 * f12)
    angle = wp.float64(0.5) * wp.atan2(wp.float64(2.0) * f12, f11 - f22)
    cx = wp.cos(angle)
    sx = wp.sin(angle)
    if mean + spread > wp.float64(0.0):
        scatter(hessian, t, cx * first + sx * second, mean + spread, basis)
    if mean - spread > wp.float64(0.0):
        scatter(hessian, t, cx * second - sx * first, mean - spread, basis)
    half = wp.float64(0.5)
    if twist > wp.float64(0.0):
        scatter(hessian, t, left * mat22(wp.float64(0.0), -one, one, wp.float64(0.0)) * right, half * twist, basis)
    if flip > wp.float64(0.0):
        scatter(hessian, t, left * mat22(wp.float64(0.0), one, one, wp.float64(0.0)) * right, half * flip, basis)

    shape = shape_excess(uv, a, b, c, mesh.least[t])
    if shape[0] > wp.float64(0.0):
        # Gauss-Newton, from the derivative of side^2 / twice by the corners.
        at = int(shape[3])
        by = mat23()
        side = uv[mesh.faces[t, (at + 1) % 3]] - uv[mesh.faces[t, at]]
        lean = shape[1] / (shape[2] * shape[2])
        for x in range(2):
            by[x, (at + 1) % 3] += wp.float64(2.0) * side[x] / shape[2]
            by[x, at] -= wp.float64(2.0) * side[x] / shape[2]
        for k in range(3):
            across = uv[mesh.faces[t, (k + 2) % 3]] - uv[mesh.faces[t, (k + 1) % 3]]
            by[0, k] += lean * across[1]
            by[1, k] -= lean * across[0]
        strong = wp.float64(2.0) * mesh.strictness * mesh.share[t]
        for p in range(3):
            for x in range(2):
                gradient[t, 2 * p + x] += strong * shape[0] * mesh.least[t] * by[x, p]
        identity = mat22(one, wp.float64(0.0), wp.float64(0.0), one)
        scatter(hessian, t, identity, strong * mesh.least[t] * mesh.least[t], by)


class Distortion:
    """The energy of maps of one mesh to the plane.

    Parameters
    ----------
    faces : (F, 3) int32 array
    rest : (F, 2, 2) float64 array
        Inverse of each triangle's edge vectors (columns) in its own plane.
    weight, share, least : (F,) float64 arrays
        Weight of a triangle's energy, weight of its area in the texture, and its least ratio of height to longest side (0: any).
    kind : {STRETCH, MIPS}
    power : float
        Exponent p of the stretch.
    strictness : float
        Weight of the shape term.
    device : str
    """

    def __init__(
        self,
        faces: np.ndarray,
        rest: np.ndarray,
        weight: np.ndarray,
        share: np.ndarray,
        least: np.ndarray,
        *,
        kind: int,
        power: float,
        strictness: float,
        device: str,
    ) -> None:
        self.device = device
        self._count = len(faces)
        self._mesh = MappedTriangles()
        self._mesh.faces = upload(faces, wp.int32, device)
        self._mesh.rest = upload(rest, mat22, device)
        self._mesh.weight, self._mesh.share, self._mesh.least = (upload(a, wp.float64, device) for a in (weight, share, least))
        self._mesh.kind, self._mesh.power, self._mesh.strictness = int(kind), float(power), float(strictness)
        self._energy = wp.empty(self._count, dtype=wp.float64, device=device)
        self._gradient = wp.empty((self._count, 6), dtype=wp.float64, device=device)
        self._hessian = wp.empty((self._count, 36), dtype=wp.float64, device=device)

    def energies(self, uv: np.ndarray) -> np.ndarray:
        """Return each triangle's energy (F,) at ``uv`` (N, 2)."""
        inputs = [upload(uv, vec2, self.device), self._mesh]
        launch(energy_kernel, self._count, inputs=inputs, outputs=[self._energy], device=self.device, work=40)
        return self._energy.numpy().copy()

    def derivatives(self, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return each triangle's gradient (F, 6) and projected Hessian (F, 6, 6) by its corners' u and v."""
        inputs = [upload(uv, vec2, self.device), self._mesh]
        launch(
            derivative_kernel, self._count, inputs=inputs, outputs=[self._gradient, self._hessian], device=self.device, work=600
        )
        return self._gradient.numpy(), self._hessian.numpy().reshape(-1, 6, 6)
