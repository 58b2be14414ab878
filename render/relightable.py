"""Rendering relightable textures: image = Σ_j c_j(l) map_j as a Mitsuba BSDF, on any mesh and under any emitter.

A texture's values are the radiance that its surface sends to the camera under a distant light of irradiance π, so that a white
matte surface lit from straight above has the value 1 and an albedo is a reflectance: the BSDF times the cosine is the value
over π.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from intaglio.render.arguments import checked, function, numbers, shaped
from intaglio.render.variants import mitsuba
from intaglio.render.views import Viewpoint, distant_light, filled_mesh, lit_mesh, make_sensor, over_background

# From the components of the light's unit vector, and the functions of an array library, to n coefficients.
Coefficients = Callable[[Any, Any, Any, Any], list[Any]]


def _repeat(name: str, value: Any, _: dict[str, Any]) -> tuple[float, ...]:
    return numbers(name, value, 2, 0.0, 1e6)


def _check_coefficients(coefficients: Coefficients, count: int) -> None:
    """Raise `ValueError` unless there is a finite weight for each map under a light from above."""
    try:
        given = np.array([float(c) for c in coefficients(np.float64(0.0), np.float64(0.0), np.float64(1.0), np)])
    except Exception as error:
        raise ValueError(f"coefficients fail under a light from above: {type(error).__name__}: {error}") from error
    if given.shape != (count,) or not np.isfinite(given).all():
        raise ValueError(f"coefficients must return {count} finite numbers, one for each of the maps, not {given.tolist()}")


class DrJitMaths:
    """Dr.Jit's functions under NumPy's names."""

    @staticmethod
    def sqrt(x: Any) -> Any:
        """Return √x."""
        return _drjit().sqrt(x)

    @staticmethod
    def log(x: Any) -> Any:
        """Return the natural logarithm."""
        return _drjit().log(x)

    @staticmethod
    def arctan2(y: Any, x: Any) -> Any:
        """Return the angle of (x, y)."""
        return _drjit().atan2(y, x)

    @staticmethod
    def where(condition: Any, yes: Any, no: Any) -> Any:
        """Choose by element."""
        return _drjit().select(condition, yes, no)

    @staticmethod
    def minimum(a: Any, b: Any) -> Any:
        """Return the lesser."""
        return _drjit().minimum(a, b)

    @staticmethod
    def maximum(a: Any, b: Any) -> Any:
        """Return the greater."""
        return _drjit().maximum(a, b)


@checked(maps=shaped(None, None, None, (1, 3)), coefficients=function, chroma=shaped(None, None, 3), repeat=_repeat)
def relightable_bsdf(
    maps: np.ndarray,
    coefficients: Coefficients,
    *,
    chroma: np.ndarray | None = None,
    repeat: tuple[float, float] = (1.0, 1.0),
    tiled: bool = True,
    smooth: bool = True,
    back: bool = False,
) -> Any:
    """Make a Mitsuba BSDF of a relightable texture.

    Parameters
    ----------
    maps : (n, H, W, C) array
        Linear values with C = 1 or 3 channels; row 0 is at v = 1.
    coefficients : callable
        The weights of the maps: ``coefficients(x, y, z, maths)`` returns a list of n values for the components of unit
        vectors towards the light, in the surface's own frame: x along u, y along v, z along the normal. ``maths`` has the
        functions ``sqrt``, ``log``, ``arctan2``, ``where``, ``minimum`` and ``maximum``. The ``basis.evaluate`` of an
        `intaglio.Relightable` is one.
    chroma : (H, W, 3) array, optional
        Colours by which the sum, of one channel, is multiplied. Default None.
    repeat : (float, float), optional
        How often the texture is repeated over the unit square of texture coordinates, along u and v. Default (1, 1).
    tiled : bool, optional
        Continue beyond a border with the opposite one; if False, with the border's own texels. Default True.
    smooth : bool, optional
        Interpolate between texels; if False, take the nearest. Default True.
    back : bool, optional
        Show the texture on the back of the surface as well. Default False.

    Returns
    -------
    mitsuba.BSDF
        The BSDF, for any mesh with texture coordinates and any emitter.

    Raises
    ------
    ValueError
        If maps and chroma have other shapes, or the coefficients are not one finite number for each map.

    See Also
    --------
    intaglio.render.relit : Render a mesh with it.

    Notes
    -----
    Negative sums are set to 0, and light from below the horizon gives 0. Directions are sampled by the cosine.

    Examples
    --------
    A texture of Lambert's law, whose maps are scaled normals:

    >>> import numpy as np
    >>> from intaglio.render import relightable_bsdf, relit_plane
    >>> maps = np.zeros((3, 4, 4, 1))
    >>> maps[2] = 0.5
    >>> bsdf = relightable_bsdf(maps, lambda x, y, z, maths: [x, y, z])
    >>> relit_plane(bsdf, size=(4, 4), light=(0, 0.6, 0.8))[0, 0].round(3)
    array([0.4, 0.4, 0.4], dtype=float32)
    """
    _check_coefficients(coefficients, len(maps))
    if chroma is not None and (chroma.shape[:2] != maps.shape[1:3] or maps.shape[3] != 1):
        raise ValueError(
            f"chroma must be {(*maps.shape[1:3], 3)}, beside maps of one channel, not {chroma.shape} beside {maps.shape}"
        )
    mi = mitsuba()
    return _bsdf_class(mi.variant())(mi.Properties(), maps, coefficients, chroma, repeat, tiled, smooth, back)


@checked(normal=shaped(None, None, 3), albedo=shaped(None, None, (1, 3)))
def matte_bsdf(normal: np.ndarray, albedo: np.ndarray) -> Any:
    """Make Mitsuba's own diffuse BSDF with a normal map, to compare with.

    It gives the same values as a relightable texture of kind "gradient", wherever these are not negative.

    Parameters
    ----------
    normal : (H, W, 3) array
        Unit vectors; x along u, y along v, z along the normal. Row 0 is at v = 1.
    albedo : (H, W, C) array
        Reflectance with C = 1 or 3 channels, clipped to [0, 1].

    Returns
    -------
    mitsuba.BSDF
        The BSDF, for any mesh with texture coordinates.

    Examples
    --------
    >>> import numpy as np
    >>> from intaglio.render import matte_bsdf, relit_plane
    >>> normal = np.zeros((4, 4, 3)) + [0.0, 0.6, 0.8]
    >>> bsdf = matte_bsdf(normal, np.full((4, 4, 1), 0.5))
    >>> relit_plane(bsdf, size=(4, 4), light=(0, 0.6, 0.8))[0, 0].round(2)
    array([0.5, 0.5, 0.5], dtype=float32)
    """
    mi = mitsuba()
    color = np.repeat(albedo, 3, axis=2) if albedo.shape[2] == 1 else albedo

    def bitmap(values: np.ndarray) -> dict[str, Any]:
        # Mitsuba's bitmaps have row 0 at v = 0, and are stored in half precision unless the format says otherwise.
        image = mi.Bitmap(np.ascontiguousarray(values[::-1], np.float32))
        return {"type": "bitmap", "bitmap": image, "raw": True, "filter_type": "nearest", "format": "variant"}

    matte = {"type": "diffuse", "reflectance": bitmap(np.clip(color, 0, 1))}
    # Lambert's law alone, without the shadowing that Mitsuba adds, and without flipping normals that face away.
    plain = {"use_shadowing_function": False, "flip_invalid_normals": False}
    return mi.load_dict({"type": "normalmap", "normalmap": bitmap(normal * 0.5 + 0.5), "nested": matte, **plain})


def textured_mesh(vertices: np.ndarray, faces: np.ndarray, uv: np.ndarray, bsdf: Any, *, flat: bool = False) -> Any:
    """Return a Mitsuba mesh with texture coordinates ``uv`` (N, 2); (0, 0) is the texture's lower left corner."""
    if np.shape(uv) != (len(vertices), 2):
        raise ValueError(f"texture coordinates must be ({len(vertices)}, 2), not {np.shape(uv)}")
    return filled_mesh(vertices, faces, bsdf, uv=uv, flat=flat)


@checked()
def relit(
    vertices: np.ndarray,
    faces: np.ndarray,
    uv: np.ndarray,
    bsdf: Any,
    *,
    camera: Viewpoint,
    light: np.ndarray,
    size: tuple[int, int] = (512, 512),
    samples: int = 16,
    background: float = 0.0,
    seed: int = 0,
) -> np.ndarray:
    """Render a textured mesh under one distant light, with cast shadows.

    Parameters
    ----------
    vertices, faces, uv : (N, 3), (F, 3), (N, 2) arrays
        Positions in any unit of length, triangles, and texture coordinates; (0, 0) is the texture's lower left corner.
    bsdf : mitsuba.BSDF
        From `relightable_bsdf` or `matte_bsdf`.
    camera : Viewpoint
        Where the picture is taken from; see `frame`.
    light : (3,) array
        Vector towards the light, of any length, in the mesh's coordinates; its irradiance is π.
    size : (int, int), optional
        Rows and columns of the picture. Default (512, 512).
    samples : int, optional
        Paths per pixel: more give smoother edges. Default 16.
    background : float, optional
        Linear value where nothing is seen. Default 0.
    seed : int, optional
        Seed of the paths: the same seed gives the same picture. Default 0.

    Returns
    -------
    (H, W, 3) float32 array
        Linear Rec.709 values; row 0 is the top.

    Raises
    ------
    ValueError
        If there is not one texture coordinate per vertex, or there are no vertices or faces.

    Examples
    --------
    >>> import numpy as np
    >>> from intaglio.render import frame, matte_bsdf, relit
    >>> vertices = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    >>> faces, uv = np.array([[0, 1, 2], [0, 2, 3]]), vertices[:, :2] / 2 + 0.5
    >>> bsdf = matte_bsdf(np.zeros((4, 4, 3)) + [0, 0, 1], np.full((4, 4, 1), 0.5))
    >>> camera = frame(vertices, direction=(0, 0, 1))
    >>> picture = relit(vertices, faces, uv, bsdf, camera=camera, light=(0, 0, 1), size=(16, 16), samples=4)
    >>> picture[8, 8].round(2), picture[0, 0]
    (array([0.5, 0.5, 0.5], dtype=float32), array([0., 0., 0.], dtype=float32))
    """
    mi = mitsuba()
    shift = np.asarray(camera.target, np.float64)
    mesh = textured_mesh(np.asarray(vertices, np.float64) - shift, faces, uv, bsdf)
    origin = np.asarray(camera.origin, np.float64) - shift
    sensor = mi.load_dict(make_sensor(origin, np.zeros(3), np.asarray(camera.up), camera.fov, size))
    return _render(mesh, sensor, light, samples, seed, background)


@checked()
def relit_plane(
    bsdf: Any, size: tuple[int, int], light: np.ndarray, *, samples: int = 1, seed: int = 0, facing: bool = True
) -> np.ndarray:
    """Render a texture on a plane under one distant light, seen straight on without perspective, with a pixel per texel.

    Parameters
    ----------
    bsdf : mitsuba.BSDF
        From `relightable_bsdf` or `matte_bsdf`.
    size : (int, int)
        Rows and columns of the texture, and of the picture.
    light : (3,) array
        Vector towards the light, of any length; x right, y up, z to the camera. Its irradiance is π.
    samples : int, optional
        Paths per pixel, spread evenly. Default 1, through the pixel's centre, which shows every texel as it is.
    seed : int, optional
        Seed of the paths. Default 0.
    facing : bool, optional
        Show the front; if False, the back. Default True.

    Returns
    -------
    (H, W, 3) float32 array
        Linear Rec.709 values; row 0 is the top.

    Examples
    --------
    >>> import numpy as np
    >>> from intaglio.render import relightable_bsdf, relit_plane
    >>> maps = np.linspace(0, 1, 6).reshape(1, 2, 3, 1)
    >>> bsdf = relightable_bsdf(maps, lambda x, y, z, maths: [0 * x + 1])
    >>> relit_plane(bsdf, size=(2, 3), light=(0, 0, 1))[..., 0].round(2)
    array([[0. , 0.2, 0.4],
           [0.6, 0.8, 1. ]], dtype=float32)
    """
    mi = mitsuba()
    height, width = size
    x, y = width / 2, height / 2
    corners = np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]], np.float64)
    faces = np.array([[0, 1, 2], [0, 2, 3]] if facing else [[0, 2, 1], [0, 3, 2]])
    mesh = textured_mesh(corners, faces, np.array([[0, 0], [1, 0], [1, 1], [0, 1]]), bsdf, flat=True)
    return _render(mesh, mi.load_dict(orthographic_sensor(size, 1.0, 10.0)), light, samples, seed, 0.0)


def orthographic_sensor(size: tuple[int, int], pixel: float, distance: float, *, jitter: bool = False) -> dict[str, Any]:
    """Return Mitsuba's description of a camera without perspective, looking down the z axis at the origin.

    Parameters
    ----------
    size : (rows, columns)
        In pixels.
    pixel : float
        Side of a pixel in the scene.
    distance : float
        Height over the plane z = 0.
    jitter : bool
        Spread the paths over the pixel at random; else evenly, a single one through its middle.
    """
    mi = mitsuba()
    height, width = size
    place = mi.ScalarTransform4f().look_at(origin=[0, 0, float(distance)], target=[0, 0, 0], up=[0, 1, 0])
    half = pixel * width / 2
    film = {
        "type": "hdrfilm",
        "width": int(width),
        "height": int(height),
        "pixel_format": "rgba",
        "rfilter": {"type": "box"},
        "component_format": "float32",
    }
    return {
        "type": "orthographic",
        "to_world": place @ mi.ScalarTransform4f().scale([half, half, 1.0]),
        "near_clip": 1e-3 * float(distance),
        "far_clip": 1e3 * float(distance),
        "film": film,
        "sampler": {"type": "independent"} if jitter else {"type": "stratified", "jitter": False},
    }


def _render(mesh: Any, sensor: Any, light: np.ndarray, samples: int, seed: int, background: float) -> np.ndarray:
    towards = np.asarray(light, np.float64) / np.linalg.norm(light)
    rendered = lit_mesh(mesh, sensor, distant_light(towards, np.pi), samples=samples, seed=seed)
    return over_background(rendered, background)


def _drjit() -> Any:
    import drjit

    return drjit


@cache
def _bsdf_class(variant_name: str) -> type:
    """Return the BSDF's class, which can be defined only after a variant is set, and belongs to that variant."""
    mi = mitsuba()
    dr = _drjit()

    class RelightableBSDF(mi.BSDF):  # type: ignore[name-defined]
        def __init__(
            self,
            properties: Any,
            maps: np.ndarray | None = None,
            coefficients: Coefficients | None = None,
            chroma: np.ndarray | None = None,
            repeat: tuple[float, float] = (1.0, 1.0),
            tiled: bool = True,
            smooth: bool = True,
            back: bool = False,
        ) -> None:
            mi.BSDF.__init__(self, properties)
            if maps is None or coefficients is None:
                raise ValueError("a relightable BSDF is made by relightable_bsdf, from maps and coefficients")
            self.count, self.channels = maps.shape[0], maps.shape[3]
            layers = [np.moveaxis(maps, 0, 2).reshape(*maps.shape[1:3], -1)]
            self.colored = chroma is not None
            if chroma is not None:
                layers.append(chroma)
            texels = np.ascontiguousarray(np.concatenate(layers, axis=2), np.float32)
            filtering = dr.FilterMode.Linear if smooth else dr.FilterMode.Nearest
            wrapping = dr.WrapMode.Repeat if tiled else dr.WrapMode.Clamp
            # Graphics hardware interpolates between texels with low precision only.
            self.texture = mi.Texture2f(
                mi.TensorXf(texels), use_accel=False, migrate=False, filter_mode=filtering, wrap_mode=wrapping
            )
            self.coefficients, self.repeat, self.back = coefficients, repeat, back
            flags = mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide
            if back:
                flags = flags | mi.BSDFFlags.BackSide
            self.m_components = [flags | mi.BSDFFlags.SpatiallyVarying | mi.BSDFFlags.Anisotropic]
            self.m_flags = self.m_components[0]

        def value(self, si: Any, wo: Any) -> Any:
            """Return the texture's value for light from ``wo``."""
            x, y, z = wo.x, wo.y, wo.z
            # If the texture coordinates are mirrored, the frame's t points against v.
            y = dr.select(dr.dot(si.sh_frame.t, si.dp_dv) < 0, -y, y)
            if self.back:
                z = dr.abs(z)
            position = mi.Point2f(si.uv.x * self.repeat[0], (1 - si.uv.y) * self.repeat[1])
            texel = self.texture.eval(position)
            weights = self.coefficients(x, y, z, DrJitMaths)
            sums = []
            for c in range(self.channels):
                total = mi.Float(0)
                for j in range(self.count):
                    total = total + weights[j] * texel[j * self.channels + c]
                sums.append(dr.maximum(total, 0))
            if self.colored:
                first = self.count * self.channels
                return mi.Color3f(*(sums[0] * texel[first + c] for c in range(3)))
            return mi.Color3f(*(sums * 3 if self.channels == 1 else sums))

        def seen(self, cosine_in: Any, cosine_out: Any, active: Any) -> Any:
            """Return where light arrives at and leaves the surface on one side, which must have the texture."""
            front = (cosine_in > 0) & (cosine_out > 0)
            return active & ((front | ((cosine_in < 0) & (cosine_out < 0))) if self.back else front)

        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
            cosine = mi.Frame3f.cos_theta(si.wi)
            wo = mi.warp.square_to_cosine_hemisphere(sample2)
            if self.back:
                wo = mi.Vector3f(wo.x, wo.y, dr.select(cosine < 0, -wo.z, wo.z))
            active = self.seen(cosine, mi.Frame3f.cos_theta(wo), active)
            record = mi.BSDFSample3f()
            record.wo = wo
            record.pdf = mi.warp.square_to_cosine_hemisphere_pdf(mi.Vector3f(wo.x, wo.y, dr.abs(wo.z)))
            record.eta = 1.0
            record.sampled_type = mi.UInt32(+mi.BSDFFlags.DiffuseReflection)
            record.sampled_component = 0
            weight = self.value(si, wo) / (dr.pi * record.pdf)
            return record, dr.select(active & (record.pdf > 0), weight, mi.Color3f(0))

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            active = self.seen(mi.Frame3f.cos_theta(si.wi), mi.Frame3f.cos_theta(wo), active)
            return dr.select(active, self.value(si, wo) / dr.pi, mi.Color3f(0))

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            active = self.seen(mi.Frame3f.cos_theta(si.wi), mi.Frame3f.cos_theta(wo), active)
            density = mi.warp.square_to_cosine_hemisphere_pdf(mi.Vector3f(wo.x, wo.y, dr.abs(wo.z)))
            return dr.select(active, density, 0)

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

        def to_string(self) -> str:
            return f"RelightableBSDF[maps={self.count}, channels={self.channels}, repeat={self.repeat}]"

    return RelightableBSDF
