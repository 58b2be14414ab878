"""What `intaglio info` says of the machine, of meshes, images and stacks."""

from __future__ import annotations

import platform
from importlib.metadata import version
from pathlib import Path

import numpy as np
import warp as wp

from intaglio.arrays import Array
from intaglio.devices import device_or_error
from intaglio.errors import FileError, IntaglioError
from intaglio.files import read_exr_header, read_image
from intaglio.geometry import is_height_field, read_geometry_texture
from intaglio.kernels.launch import threads
from intaglio.mesh import Surface, border_loops, holds_points, pieces, read_point_file, read_surface, used_vertices
from intaglio.photometric import (
    ATTRIBUTE,
    checked_lights,
    examine_capture,
    polar_plot,
    read_light_positions,
    read_relightable,
    table_lines,
    tilt_and_slant,
)
from intaglio.relief import fit_base, list_holes, sampling_distance
from intaglio.render import variant
from intaglio.synthesis import read_material

_MOST_HOLES, _MOST_SCANS = 12, 6
# Of larger clouds no surface is looked for: that would take minutes.
_MOST_POINTS = 200_000


def system_facts(asked: str | None) -> list[str]:
    """Return versions, devices, threads and the renderer's variant with the reason for it."""
    packages = ("warp-lang", "mitsuba", "numpy", "scipy", "trimesh", "OpenEXR")
    chosen = variant()
    device = device_or_error(asked)
    return [
        f"intaglio {version('intaglio')}, Python {platform.python_version()} on {platform.platform()}",
        ", ".join(f"{p} {version(p)}" for p in packages),
        f"devices: {', '.join(str(d) for d in wp.get_devices())}; in use {device}; {threads()} CPU threads",
        f"renderer: {chosen.name} ({chosen.reason})",
    ]


def mesh_facts(path: Path, strict: bool) -> list[str]:
    """Return size, bounds, provenance, pieces, borders, sampling and best base of a mesh file."""
    surface = read_surface(path, strict=strict)
    used = used_vertices(surface.faces, len(surface.vertices))
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    lines = [
        f"{len(surface.vertices)} vertices ({int((~used).sum())} in no face), {len(surface.faces)} faces",
        f"bounds {np.array2string(low, precision=6)} to {np.array2string(high, precision=6)}",
        f"colour per vertex: {'yes' if surface.color is not None else 'no'}",
    ]
    if not surface.measured.all():
        lines.append(f"provenance: {int(surface.measured.sum())} measured, {int((~surface.measured).sum())} filled vertices")
    if len(surface.faces):
        _, label = pieces(surface.faces, len(surface.vertices))
        loops = border_loops(surface.faces)
        sizes = ", ".join(str(len(loop)) for loop in loops[:8]) + (", …" if len(loops) > 8 else "")
        lines.append(f"{len(np.unique(label[used]))} pieces; {len(loops)} border loops" + (f" of {sizes} edges" if loops else ""))
        lines += _hole_lines(surface)
        lines.append(sampling_distance(surface.vertices, surface.faces)[1])
    if surface.model is not None:
        lines.append(f"base: {surface.model.describe()}")
    else:
        try:
            fitted = fit_base(surface.vertices[used])
            lines += [f"best base: {fitted.describe()}", f"  {fitted.fit.note}" if fitted.fit else ""]
        except IntaglioError as error:
            lines.append(f"best base: none ({error})")
    return [*lines, *surface.notes]


def _hole_lines(surface: Surface) -> list[str]:
    """The longest holes and borders, numbered as `complete --holes` takes them."""
    try:
        holes = list_holes(surface)
    except IntaglioError as problem:
        return [f"holes: {problem}"]
    more = [f"  … and {len(holes) - _MOST_HOLES} shorter ones"] if len(holes) > _MOST_HOLES else []
    return [f"  {hole.describe()}" for hole in holes[:_MOST_HOLES]] + more


def point_facts(path: Path) -> list[str]:
    """Return number, bounds and what a file holds of its points; of all but large clouds, sampling and kind of surface too."""
    found = read_point_file(path)
    low, high = _place(found.points.min(axis=0)), _place(found.points.max(axis=0))
    intensity = found.intensity
    lines = [
        f"{len(found)} points",
        f"bounds {low} to {high}",
        f"colour per point: {'yes' if found.color is not None else 'no'}; "
        f"intensity: {'no' if intensity is None else f'{intensity.min():.6g} to {intensity.max():.6g}'}; "
        f"normals: {'yes' if found.normals is not None else 'no'}",
    ]
    if found.viewpoints is None:
        lines.append("scan positions: unknown")
    else:
        places = [_place(place) for place in found.viewpoints[:_MOST_SCANS]]
        more = [f"and {len(found.viewpoints) - _MOST_SCANS} more"] if len(found.viewpoints) > _MOST_SCANS else []
        lines.append(f"scan positions: {', '.join([*places, *more])}")
    if len(found) > _MOST_POINTS:
        return [*lines, f"sampling and kind of surface: not looked at for more than {_MOST_POINTS:,} points", *found.notes]
    return [*lines, *_swatch_lines(path, found.notes)]


def _place(point: Array) -> str:
    # Ten digits tell millimetres in survey coordinates.
    return f"({', '.join(f'{value:.10g}' for value in point)})"


def _swatch_lines(path: Path, notes: tuple[str, ...]) -> list[str]:
    """Sampling, height axis and kind of surface of points, as a swatch of geometry texture; or why they are none."""
    try:
        texture = read_geometry_texture(path)
    except IntaglioError as problem:
        return [f"no swatch of geometry texture: {str(problem).removeprefix(f'{path}: ')}", *notes]
    points = texture.points
    field = is_height_field(points.points, texture.axis, texture.spacing, points.normals)
    return [
        f"as a swatch: {len(points)} points with normals, {texture.spacing:.4g} apart; height axis {'xyz'[texture.axis]}",
        "a height field" if field else "surfaces over one another, no height field",
        *texture.notes,
    ]


def image_facts(path: Path) -> list[str]:
    """Return size and range of an image file's linear values."""
    image = read_image(path)
    channels = 1 if image.ndim == 2 else image.shape[2]
    lines = [f"{image.shape[1]} x {image.shape[0]} pixels, {channels} channel{'s' if channels > 1 else ''} (linear values below)"]
    for c in range(channels):
        plane = image if image.ndim == 2 else image[:, :, c]
        finite = plane[np.isfinite(plane)]
        odd = plane.size - finite.size
        if not finite.size:
            lines.append(f"channel {c}: no value is finite")
            continue
        lines.append(
            f"channel {c}: least {finite.min():.5g}, mean {finite.mean(dtype=np.float64):.5g}, most {finite.max():.5g}; "
            f"{np.mean(finite >= 1):.2%} at or over 1, {np.mean(finite <= 0):.2%} at or under 0"
            + (f"; {odd} values are not finite" if odd else "")
        )
    return lines


def material_facts(path: Path) -> list[str]:
    """Return size and files of the maps of a material in a folder."""
    material = read_material(path)
    height, width = material.shape
    lines = [f"material: {len(material.maps)} map{'s' if len(material.maps) > 1 else ''} of {width} x {height} pixels"]
    for kind, values in material.maps.items():
        channels = 1 if values.ndim == 2 else values.shape[2]
        depth = "floats" if material.bits[kind] == 32 else f"{material.bits[kind]} bits"
        lines.append(f"{kind}: {material.files[kind]}, {depth}, {channels} channel{'s' if channels > 1 else ''}")
    return [*lines, *material.notes]


def stack_facts(path: Path) -> list[str]:
    """Return number, size, lights on a polar plot, and a table of a stack's photographs; of lights alone, just those."""
    try:
        stack, photographs = examine_capture(path, "linear")
    except IntaglioError as problem:
        if path.suffix.lower() != ".lp":
            if path.is_file() and holds_points(path):
                return point_facts(path)
            raise
        names, lights = read_light_positions(path)
        high = lights[:, 2] > 0
        low = [f"{int((~high).sum())} of them on or below the horizon"] if high.any() and not high.all() else []
        above = checked_lights(lights[high] if low else lights, tuple(names))
        return [f"{len(lights)} lights", *low, *_light_facts(above), f"the images can't be read: {problem}"]
    count, height, width, channels = stack.shape
    used = [one for one in photographs if one.used]
    over, under = (float(np.mean(shares)) for shares in ([one.over for one in used], [one.black for one in used]))
    return [
        f"stack of {count} images, {width} x {height} pixels, {channels} channel{'s' if channels > 1 else ''}",
        *_light_facts(stack.lights),
        f"overexposed {over:.2%}, black {under:.2%} of the values",
        "photographs (mean over the cosine of the slant; sharpness; pixels off those lit most alike):",
        *(f"  {line}" for line in table_lines(photographs)),
        *stack.notes,
    ]


def texture_facts(path: Path) -> list[str]:
    """Return kind, size and what was chosen of a relightable texture."""
    texture = read_relightable(path)
    height, width, channels = texture.shape
    kind = "colour" if channels == 3 else "grey"
    return [
        f"relightable texture, kind {texture.kind}: {len(texture.maps)} maps of {width} x {height} pixels, {kind}"
        + (" by luminance and chromaticity" if texture.chroma is not None else ""),
        f"coefficients by a {texture.basis.parameters()['basis']} basis",
        *texture.notes,
    ]


def is_texture(path: Path) -> bool:
    """Tell whether a file is a relightable texture: a .ptm, or an EXR that describes one."""
    if path.suffix.lower() != ".exr":
        return path.suffix.lower() == ".ptm"
    try:
        return ATTRIBUTE in read_exr_header(path)
    except FileError:
        return False  # whatever it is, the reader of images says


def _light_facts(lights: Array) -> list[str]:
    tilt, slant = tilt_and_slant(lights)
    return [
        f"light slant {slant.min():.1f} to {slant.max():.1f} degrees, tilt {tilt.min():.1f} to {tilt.max():.1f} degrees",
        "lights from above (rings at slants of 45 and 90 degrees):",
        *(f"  {line}" for line in polar_plot(lights)),
    ]
