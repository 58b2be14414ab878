"""Rendering textures that answer to light: image = Σ_j c_j(l) map_j as a Mitsuba BSDF, on any mesh and under any emitter.

A texture's values are what its surface sends to the camera under a distant light of irradiance π, so that a white matte
surface lit from straight above has the value 1 and an albedo is a reflectance: the BSDF (with the cosine) is the value over π.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from intaglio.render.variants import mitsuba
from intaglio.render.views import Viewpoint, distant_light, filled_mesh, lit_mesh, make_sensor, over_background

# From the components of the light's unit vector, and the functions of an array library, to n coefficients.
Coefficients = Callable[[Any, Any, Any, Any], list[Any]]


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
    """Return a Mitsuba BSDF of a relightable texture.

    Parameters
    ----------
    maps : (n, H, W, C) array
        C is 1 or 3; row 0 lies at v = 1.
    coefficients : callable
        ``coefficients(x, y, z, maths)`` gives n values for the components of unit vectors towards the light, in the surface's own
        frame: x along u, y along v, z along the normal.
    chroma : (H, W, 3) array, optional
        Multiplied with the sum.
    repeat : (u, v)
        How often the texture is repeated over the unit square of texture coordinates.
    tiled : bool
        Go on with the opposite border beyond a border; else with the border's own texels.
    smooth : bool
        Interpolate between texels, or take the nearest.
    back : bool
        Show the texture on the back as well.

    Notes
    -----
    The sum is cut off at 0 and is 0 for light from below the horizon. Directions are sampled by the cosine.
    """
    mi = mitsuba()
    return _bsdf_class(mi.variant())(mi.Properties(), maps, coefficients, chroma, repeat, tiled, smooth, back)


def matte_bsdf(normal: np.ndarray, albedo: np.ndarray) -> Any:
    """Return Mitsuba's own diffuse BSDF under its normal map: the same as kind "gradient" where it is not cut off at 0.

    Parameters
    ----------
    normal : (H, W, 3) array
        Unit vectors; row 0 lies at v = 1.
    albedo : (H, W, C) array
        Reflectance; Mitsuba cuts it off at 1.
    """
    mi = mitsuba()
    color = np.repeat(albedo, 3, axis=2) if albedo.shape[2] == 1 else albedo

    def bitmap(values: np.ndarray) -> dict[str, Any]:
        # Mitsuba's bitmaps have row 0 at v = 0, and are stored in half precision unless told.
        image = mi.Bitmap(np.ascontiguousarray(values[::-1], np.float32))
        return {"type": "bitmap", "bitmap": image, "raw": True, "filter_type": "nearest", "format": "variant"}

    matte = {"type": "diffuse", "reflectance": bitmap(np.clip(color, 0, 1))}
    # Lambert's law alone: without the shadowing that Mitsuba adds, and without turning normals that face away.
    plain = {"use_shadowing_function": False, "flip_invalid_normals": False}
    return mi.load_dict({"type": "normalmap", "normalmap": bitmap(normal * 0.5 + 0.5), "nested": matte, **plain})


def textured_mesh(vertices: np.ndarray, faces: np.ndarray, uv: np.ndarray, bsdf: Any, *, flat: bool = False) -> Any:
    """Return a Mitsuba mesh with texture coordinates ``uv`` (N, 2); (0, 0) is the texture's lower left corner."""
    if np.shape(uv) != (len(vertices), 2):
        raise ValueError(f"texture coordinates must be ({len(vertices)}, 2), not {np.shape(uv)}")
    return filled_mesh(vertices, faces, bsdf, uv=uv, flat=flat)


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
    bsdf : Mitsuba BSDF
        From `relightable_bsdf` or `matte_bsdf`.
    camera : Viewpoint
    light : (3,) array
        Vector towards the light, in the mesh's coordinates; its irradiance is π.
    size : (rows, columns)
    samples : int
        Paths per pixel.
    background : float
        Linear value where nothing is seen.
    seed : int

    Returns
    -------
    (H, W, 3) float32 array
        Linear Rec.709.
    """
    mi = mitsuba()
    shift = np.asarray(camera.target, np.float64)
    mesh = textured_mesh(np.asarray(vertices, np.float64) - shift, faces, uv, bsdf)
    origin = np.asarray(camera.origin, np.float64) - shift
    sensor = mi.load_dict(make_sensor(origin, np.zeros(3), np.asarray(camera.up), camera.fov, size))
    return _render(mesh, sensor, light, samples, seed, background)


def relit_plane(
    bsdf: Any, size: tuple[int, int], light: np.ndarray, *, samples: int = 1, seed: int = 0, facing: bool = True
) -> np.ndarray:
    """Render a texture on a plane, seen straight on without perspective, a pixel per texel, under one distant light.

    Parameters
    ----------
    bsdf : Mitsuba BSDF
    size : (rows, columns)
        Of the texture.
    light : (3,) array
        Vector towards the light; x right, y up, z to the camera.
    samples : int
        Paths per pixel, evenly over it: one goes through its middle.
    seed : int
    facing : bool
        Show the front; else the back.

    Returns
    -------
    (H, W, 3) float32 array
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
    """Return the BSDF's class; it can be defined only once a variant is set, and belongs to it."""
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
            # Graphics hardware would place samples between texels coarsely.
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
            # Where texture coordinates are mirrored the frame's t points against v.
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
            """Return where light can reach and leave the same side, that which has the texture."""
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
