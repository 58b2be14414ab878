"""Pictures of a mesh in a light that shows relief."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from intaglio.render.arguments import checked, instance, number, numbers, shaped
from intaglio.render.variants import mitsuba

#: Linear reflectance of the clay in which meshes without colours are shown.
CLAY = (0.55, 0.5, 0.45)


@dataclass(frozen=True)
class Viewpoint:
    """Perspective camera that looks from one point at another.

    Parameters
    ----------
    origin : (float, float, float)
        Where the eye is, in the mesh's coordinates.
    target : (float, float, float)
        The point in the middle of the picture.
    up : (float, float, float), optional
        Direction that is upright in the picture; it must not be along the line of sight. Default y.
    fov : float, optional
        Vertical field of view in degrees. Default 25, a moderate telephoto lens, which hardly distorts.

    Raises
    ------
    ValueError
        If a place is not three finite numbers, eye and target are one, ``up`` is along the line of sight, or ``fov`` is not
        between 0 and 180.

    See Also
    --------
    intaglio.render.frame : A viewpoint that sees all of a mesh.

    Examples
    --------
    >>> from intaglio.render import Viewpoint
    >>> Viewpoint(origin=(0, 0, 5), target=(0, 0, 0)).up
    (0.0, 1.0, 0.0)
    """

    origin: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)
    fov: float = 25.0

    def __post_init__(self) -> None:
        for name in ("origin", "target", "up"):
            object.__setattr__(self, name, numbers(name, getattr(self, name), 3))
        number(0, 180, open_ends=True)("fov", self.fov, {})
        along = np.subtract(self.target, self.origin)
        if not along.any():
            raise ValueError(f"origin and target must be two places, not both {self.origin}")
        up = np.array(self.up)
        if not up.any() or not np.cross(along / np.abs(along).max(), up / np.abs(up).max()).any():
            raise ValueError(f"up must not be zero nor along the line of sight, not {self.up}")


@dataclass(frozen=True)
class Light:
    """Distant light fixed to the camera, with a weak headlight that keeps shadows readable.

    Parameters
    ----------
    tilt : float, optional
        Direction in the plane of the picture in degrees, from right (0) to up (90). Default 135, the upper left, where
        people expect the light.
    slant : float, optional
        Angle from the line of sight in degrees: 0 is a headlight, 70 rakes over the surface and shows the slightest relief.
        Default 60.
    strength : float, optional
        Irradiance of the distant light, at least 0; π makes a white matte surface that faces it 1. Default 4.2, which uses
        the range of a picture for clay.
    fill : float, optional
        Irradiance of the headlight, at the camera's target, at least 0. It shines from the eye: nothing that is seen lies in
        its shadow. Default 0.4.

    Examples
    --------
    >>> from intaglio.render import Light
    >>> raking = Light(slant=75)
    >>> raking.tilt, raking.slant
    (135.0, 75)
    """

    tilt: float = 135.0
    slant: float = 60.0
    strength: float = 4.2
    fill: float = 0.4

    def __post_init__(self) -> None:
        for name, low in (("tilt", -1e6), ("slant", -1e6), ("strength", 0), ("fill", 0)):
            number(low, 1e6)(name, getattr(self, name), {})


@checked()
def frame(
    vertices: np.ndarray, direction: np.ndarray, *, up: ArrayLike = (0.0, 1.0, 0.0), fov: float = 25.0, margin: float = 1.1
) -> Viewpoint:
    """Place a camera so that it sees all of a mesh from a given direction.

    Parameters
    ----------
    vertices : (N, 3) array
        The mesh's vertices, in any unit of length.
    direction : (3,) array
        Direction from the object to the eye, of any length but zero.
    up : (3,) array, optional
        Direction that is upright in the picture. Default y; if it is within 8 degrees of the line of sight, another axis is
        taken.
    fov : float, optional
        Vertical field of view in degrees. Default 25.
    margin : float, optional
        Radius that is seen, in radii of the sphere about the mesh. Default 1.1, which leaves a narrow border.

    Returns
    -------
    Viewpoint
        A camera that looks at the middle of the mesh's bounding box.

    Raises
    ------
    ValueError
        If the vertices all lie in one place, or an argument is not what is said above.

    Examples
    --------
    >>> import numpy as np
    >>> from intaglio.render import frame
    >>> camera = frame(np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]]), direction=(0, 0, 1))
    >>> camera.target, camera.origin[2] > 4
    ((0.0, 0.0, 0.0), True)
    """
    towards = direction / np.linalg.norm(direction)
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    radius = float(np.linalg.norm(vertices - middle, axis=1).max())
    distance = margin * radius / np.sin(np.radians(fov) / 2)
    if not radius > 0 or not distance < 1e15:
        raise ValueError("vertices all lie in one place, or fov is too narrow to show them")
    upward = np.asarray(up, np.float64)
    if abs(upward @ towards) > 0.99 * np.linalg.norm(upward):
        upward = np.eye(3)[np.argmin(np.abs(towards))]
    return Viewpoint(_triple(middle + distance * towards), _triple(middle), _triple(upward), fov)


def _colors(name: str, value: Any, before: dict[str, Any]) -> np.ndarray:
    return shaped(len(before["vertices"]), 3)(name, value, before)


def _reflectances(name: str, value: Any, _: dict[str, Any]) -> tuple[float, ...]:
    return numbers(name, value, 3, 0.0, 1.0)


def _triple(vector: np.ndarray) -> tuple[float, float, float]:
    return float(vector[0]), float(vector[1]), float(vector[2])


@checked(colors=_colors, light=instance("Light"), albedo=_reflectances)
def view(
    vertices: np.ndarray,
    faces: np.ndarray,
    *,
    camera: Viewpoint,
    colors: np.ndarray | None = None,
    light: Light = Light(),
    size: tuple[int, int] = (512, 512),
    samples: int = 16,
    albedo: tuple[float, float, float] = CLAY,
    background: float = 1.0,
    flat: bool = False,
    seed: int = 0,
) -> np.ndarray:
    """Render a mesh in matte clay, or in its vertex colours, under raking light.

    Parameters
    ----------
    vertices, faces : (N, 3), (F, 3) arrays
        Positions in any unit of length, and triangles. Large survey coordinates lose nothing: they are moved to the camera's
        target before they are rounded to single precision.
    camera : Viewpoint
        Where the picture is taken from; see `frame`.
    colors : (N, 3) array, optional
        Linear reflectances in [0, 1] at the vertices. Default None: clay.
    light : Light, optional
        The light, fixed to the camera. Default: raking light from the upper left, which shows relief.
    size : (int, int), optional
        Rows and columns of the picture. Default (512, 512).
    samples : int, optional
        Paths per pixel: more give smoother edges. Default 16.
    albedo : (float, float, float), optional
        Linear reflectance of clay, in [0, 1]. Default a warm grey.
    background : float, optional
        Linear value where nothing is seen. Default 1, white paper.
    flat : bool, optional
        Show facets instead of interpolating normals. Default False.
    seed : int, optional
        Seed of the paths: the same seed gives the same picture. Default 0.

    Returns
    -------
    (H, W, 3) float32 array
        Linear Rec.709 values; row 0 is the top.

    Raises
    ------
    ValueError
        If there are no vertices or faces.

    Examples
    --------
    >>> import numpy as np
    >>> from intaglio.render import frame, view
    >>> vertices = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    >>> faces = np.array([[0, 1, 2], [0, 2, 3]])
    >>> camera = frame(vertices, direction=(0, 0, 1))
    >>> picture = view(vertices, faces, camera=camera, size=(16, 16), samples=4)
    >>> picture.shape
    (16, 16, 3)
    >>> bool(picture[8, 8].max() < 0.9), picture[0, 0].round(2)
    (True, array([1., 1., 1.], dtype=float32))
    """
    mi = mitsuba()
    shift = np.asarray(camera.target, np.float64)
    mesh = make_mesh(np.asarray(vertices, np.float64) - shift, faces, colors=colors, flat=flat, albedo=albedo)
    origin = np.asarray(camera.origin, np.float64) - shift
    head = {"type": "rgb", "value": float(light.fill * (origin @ origin))}
    lights: list[dict[str, object]] = [
        distant_light(light_towards(origin, camera.up, light), light.strength),
        {"type": "point", "position": origin.tolist(), "intensity": head},
    ]
    sensor = mi.load_dict(make_sensor(origin, np.zeros(3), np.asarray(camera.up), camera.fov, size))
    rendered = np.zeros((size[0], size[1], 4), np.float32)
    # The lights are rendered one by one, since choosing between them at random would make the picture grainy.
    for shining in lights:
        lit = lit_mesh(mesh, sensor, shining, samples=samples, seed=seed)
        rendered[:, :, :3] += lit[:, :, :3]
        rendered[:, :, 3] = lit[:, :, 3]
    return over_background(rendered, background)


def distant_light(towards: np.ndarray, irradiance: float) -> dict[str, object]:
    """Return Mitsuba's description of a distant light, given the unit vector ``towards`` it."""
    strength = {"type": "rgb", "value": float(irradiance)}
    return {"type": "directional", "direction": [-float(t) for t in towards], "irradiance": strength}


def lit_mesh(mesh: object, sensor: object, light: dict[str, object], *, samples: int, seed: int) -> np.ndarray:
    """Render a mesh under one light, without interreflections, as (H, W, 4) float32 with alpha."""
    mi = mitsuba()
    integrator = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
    scene = mi.load_dict({"type": "scene", "integrator": integrator, "mesh": mesh, "light": light})
    return np.array(mi.render(scene, sensor=sensor, spp=samples, seed=seed & 0xFFFFFFFF), dtype=np.float32)


def over_background(rendered: np.ndarray, background: float) -> np.ndarray:
    """Return a rendering with alpha (H, W, 4), placed over a grey ``background``, as (H, W, 3)."""
    alpha = np.clip(rendered[:, :, 3:4], 0, 1)
    return np.ascontiguousarray(rendered[:, :, :3] + (1 - alpha) * np.float32(background))


def light_towards(origin: np.ndarray, up: ArrayLike, light: Light) -> np.ndarray:
    """Return the unit vector towards the light for a camera at ``origin`` that looks at 0."""
    z = origin / np.linalg.norm(origin)
    x = np.cross(np.asarray(up, np.float64), z)
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    tilt, slant = np.radians(light.tilt), np.radians(light.slant)
    return np.cos(tilt) * np.sin(slant) * x + np.sin(tilt) * np.sin(slant) * y + np.cos(slant) * z


def make_sensor(origin: np.ndarray, target: np.ndarray, up: np.ndarray, fov: float, size: tuple[int, int]) -> dict[str, object]:
    """Return Mitsuba's description of a perspective camera with an RGBA film of ``size`` (rows, columns)."""
    mi = mitsuba()
    return {
        "type": "perspective",
        "fov": float(fov),
        "fov_axis": "y",
        "to_world": mi.ScalarTransform4f().look_at(
            origin=[float(x) for x in origin], target=[float(x) for x in target], up=[float(x) for x in up]
        ),
        "film": {
            "type": "hdrfilm",
            "width": int(size[1]),
            "height": int(size[0]),
            "pixel_format": "rgba",
            "rfilter": {"type": "gaussian"},
        },
        "sampler": {"type": "independent"},
    }


def make_mesh(
    vertices: np.ndarray,
    faces: np.ndarray,
    *,
    colors: np.ndarray | None = None,
    flat: bool = False,
    albedo: tuple[float, float, float] = CLAY,
) -> object:
    """Return a Mitsuba mesh with a matte, two-sided material."""
    mi = mitsuba()
    if colors is None:
        reflectance = {"type": "rgb", "value": [float(a) for a in albedo]}
    else:
        reflectance = {"type": "mesh_attribute", "name": "vertex_color"}
    bsdf = mi.load_dict({"type": "twosided", "nested": {"type": "diffuse", "reflectance": reflectance}})
    return filled_mesh(vertices, faces, bsdf, colors=colors, flat=flat)


def filled_mesh(
    vertices: np.ndarray,
    faces: np.ndarray,
    bsdf: object,
    *,
    colors: np.ndarray | None = None,
    uv: np.ndarray | None = None,
    flat: bool = False,
) -> object:
    """Return a Mitsuba mesh of a material, with colours (N, 3) or texture coordinates (N, 2) at the vertices."""
    mi = mitsuba()
    vertices, faces = np.asarray(vertices), np.asarray(faces)
    if len(vertices) == 0 or len(faces) == 0:
        raise ValueError(f"there is nothing to render: {len(vertices)} vertices, {len(faces)} faces")
    properties = mi.Properties()
    properties["bsdf"] = bsdf
    mesh = mi.Mesh(
        "surface",
        vertex_count=len(vertices),
        face_count=len(faces),
        has_vertex_normals=not flat,
        has_vertex_texcoords=uv is not None,
        props=properties,
    )
    if colors is not None:
        mesh.add_attribute("vertex_color", 3, np.ascontiguousarray(colors, np.float32).ravel().tolist())
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = np.ascontiguousarray(vertices, np.float32).ravel()
    parameters["faces"] = np.ascontiguousarray(faces, np.uint32).ravel()
    if uv is not None:
        parameters["vertex_texcoords"] = np.ascontiguousarray(uv, np.float32).ravel()
    parameters.update()
    if not flat:
        mesh.recompute_vertex_normals()
    return mesh
