"""Attack on the public functions: every argument in turn gets what it was not made for.

A call may give a sound result, or end with IntaglioError, TypeError or ValueError that names the argument or the file. All
else is a defect: another exception, a message without the name, a NumPy warning, NaN in a result, imaginary or masked parts
lost in silence, other bits for the same values in another memory layout, altered input, a crash, a hang, runaway memory.

Calls run in processes of their own under limits. As a script it makes all calls and lists the defects:

    python tests/api_attack.py [NAME ...] [--jobs 2]
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import dataclasses
import inspect
import io
import json
import os
import re
import resource
import select
import subprocess
import sys
import tempfile
import threading
import warnings
from pathlib import Path

import numpy as np

SECONDS = 10
WARM_SECONDS = 120
MEMORY = 2 << 30


# What every argument is given, made from the valid value: (make, how the call is judged).
# "same": the same values in another form, accepted with the same bits or refused; "refuse": must raise; "any": either.
def array_like(valid):
    """Return the valid value as an array if it is one or a list of numbers, or an 8 x 8 ramp."""
    try:
        array = np.array(valid)
    except (ValueError, TypeError):
        array = None
    if array is None or array.dtype.kind not in "biuf" or array.size == 0 or array.ndim == 0:
        return np.linspace(0, 1, 64).reshape(8, 8)
    return array


def shape_of(value):
    """Return the shape of an array, or of lists of numbers; None for anything else."""
    try:
        return np.shape(value)
    except ValueError:
        return None


def spoiled(valid, value):
    array = array_like(valid)
    array = array.astype(np.result_type(array.dtype, np.float32) if array.dtype.kind in "biu" else array.dtype)
    array.reshape(-1)[array.size // 2] = value
    return array


def masked(valid):
    array = array_like(valid)
    mask = np.zeros(array.shape, bool)
    mask.reshape(-1)[array.size // 2] = True
    return np.ma.masked_array(array, mask)


def read_only(valid):
    array = array_like(valid).copy()
    array.setflags(write=False)
    return array


def backwards(valid):
    array = array_like(valid)
    return np.ascontiguousarray(array[::-1])[::-1]


def strided(valid):
    array = array_like(valid)
    wide = np.zeros((*array.shape[:-1], 2 * array.shape[-1]), array.dtype)
    wide[..., ::2] = array
    return wide[..., ::2]


def endless():
    while True:
        yield 0.5


class Plain:
    """A class that knows nothing."""


BAD = {
    "None": (lambda v: None, "any"),
    "text": (lambda v: "text", "any"),
    "empty text": (lambda v: "", "any"),
    "bytes": (lambda v: b"", "any"),
    "long name": (lambda v: "x" * 5000 + ".png", "any"),
    "NUL": (lambda v: "a\0b", "any"),
    "object": (lambda v: object(), "any"),
    "list": (lambda v: [], "any"),
    "dict": (lambda v: {}, "any"),
    "ragged": (lambda v: [[1], [2, 3]], "any"),
    "True": (lambda v: True, "any"),
    "-1": (lambda v: -1, "any"),
    "0": (lambda v: 0, "any"),
    "10**30": (lambda v: 10**30, "any"),
    "10**400": (lambda v: 10**400, "any"),
    "1e308": (lambda v: 1e308, "any"),
    "-1e308": (lambda v: -1e308, "any"),
    "1e-320": (lambda v: 1e-320, "any"),
    "nan": (lambda v: float("nan"), "any"),
    "inf": (lambda v: float("inf"), "any"),
    "1j": (lambda v: 1j, "any"),
    "function": (lambda v: lambda *given: None, "any"),
    "class": (lambda v: Plain, "any"),
    "missing file": (lambda v: Path("missing") / "file.png", "any"),
    "folder": (lambda v: Path("."), "any"),
    "two texts": (lambda v: ("a", "b"), "any"),
    "two huge": (lambda v: (1e308, -1e308), "any"),
    "two NaN": (lambda v: (float("nan"), float("nan")), "any"),
    "three None": (lambda v: (None, None, None), "any"),
    "0-d": (lambda v: np.array(0.5), "any"),
    "1-d": (lambda v: np.linspace(0, 1, 5), "any"),
    "5-d": (lambda v: np.zeros((2, 2, 2, 2, 2)), "any"),
    "one NaN": (lambda v: spoiled(v, np.nan), "any"),
    "one inf": (lambda v: spoiled(v, np.inf), "any"),
    "one huge": (lambda v: spoiled(v, np.finfo(spoiled(v, 0).dtype).max), "any"),
    "one -1e9": (lambda v: spoiled(v, -1e9), "any"),
    "all 0": (lambda v: np.zeros_like(array_like(v)), "any"),
    "all the same": (lambda v: np.ones_like(array_like(v)), "any"),
    "all 1e300": (lambda v: array_like(v) * 0.0 + 1e300, "any"),
    "all NaN": (lambda v: array_like(v) * np.nan, "any"),
    "complex": (lambda v: array_like(v) + 0.5j, "refuse"),
    "masked": (masked, "refuse"),
    "matrix": (lambda v: array_like(v).reshape(len(array_like(v)), -1).view(np.matrix), "any"),
    "objects": (lambda v: array_like(v).astype(object), "any"),
    "objects of all kinds": (lambda v: np.full(array_like(v).shape, None, object), "any"),
    "strings": (lambda v: array_like(v).astype(str), "any"),
    "dates": (lambda v: np.zeros(array_like(v).shape, "datetime64[s]"), "any"),
    "records": (lambda v: np.zeros(array_like(v).shape, [("a", "f4"), ("b", "i4")]), "any"),
    "(0,)": (lambda v: np.zeros(0), "any"),
    "(0, 3)": (lambda v: np.zeros((0, 3)), "any"),
    "Fortran": (lambda v: np.asfortranarray(array_like(v)), "same"),
    "backwards": (backwards, "same"),
    "strided": (strided, "same"),
    "read-only": (read_only, "same"),
    "big-endian": (lambda v: array_like(v).astype(array_like(v).dtype.newbyteorder(">")), "same"),
    "nested lists": (lambda v: array_like(v).tolist(), "any"),
    "int": (lambda v: array_like(v).astype(int), "any"),
    "bool": (lambda v: array_like(v) > 0, "any"),
    "uint8": (lambda v: array_like(v).astype(np.uint8), "any"),
    "float16": (lambda v: array_like(v).astype(np.float16), "any"),
    "float128": (lambda v: array_like(v).astype(np.longdouble), "any"),
    "memoryview": (lambda v: memoryview(np.ascontiguousarray(array_like(v))), "any"),
    "one shorter": (lambda v: array_like(v)[:-1], "any"),
    "one more axis": (lambda v: array_like(v)[None], "any"),
    "endless": (lambda v: endless(), "any"),
}  # fmt: skip


def inside(valid, key, bad):
    """Return the valid dict, list or tuple with one of its values replaced."""
    if isinstance(valid, dict):
        return {**valid, key: bad}
    changed = list(valid)
    changed[key] = bad
    return tuple(changed) if isinstance(valid, tuple) else changed


class Table:
    """Valid calls of the public functions, made when they are asked for: small, and fast where the function is."""

    def __init__(self):
        self.made = {}

    def __getattr__(self, name):
        if name.startswith("_") or "make_" + name not in dir(type(self)):
            raise AttributeError(name)
        if name not in self.made:
            self.made[name] = getattr(self, "make_" + name)()
        return self.made[name]

    # Ingredients.

    def make_it(self):
        import intaglio

        return intaglio

    def make_render(self):
        import intaglio.render

        return intaglio.render

    def make_square(self):
        corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
        return self.it.Surface(vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32))

    def make_grid(self):
        """A waved sheet of 12 x 12 points with a hole of 2 x 2."""
        x, y = np.meshgrid(np.arange(12.0), np.arange(12.0))
        points = np.stack([x, y, 0.4 * np.sin(x) + 0.3 * np.cos(1.3 * y)], axis=-1)
        points[5:7, 5:7] = np.nan
        return points

    def make_scan(self):
        return self.it.surface_from_range_image(self.grid, view=(6, 6, 100.0))

    def make_sheet(self):
        x, y = np.meshgrid(np.arange(10.0), np.arange(10.0))
        points = np.column_stack([x.ravel(), y.ravel(), 0.2 * np.sin(x.ravel())])
        return self.it.surface_from_points(points, direction=(0, 0, -1))

    def make_completed(self):
        """A sheet whose middle is marked as filled, every field set."""
        sheet = self.sheet
        filled = (np.abs(sheet.vertices[:, :2] - 4.5) < 2).all(axis=1)
        count = len(filled)
        return self.it.Surface(
            vertices=sheet.vertices,
            faces=sheet.faces,
            base=sheet.vertices * [1, 1, 0],
            normal=np.tile([0.0, 0.0, 1.0], (count, 1)),
            color=np.linspace(0, 1, 3 * count).reshape(count, 3),
            measured=~filled,
            source=np.where(filled, 0, np.arange(count)),
            rotation=np.where(filled, 0.5, 0.0),
            error=np.where(filled, 0.1, 0.0),
            model=self.it.Plane(point=(0, 0, 0), normal=(0, 0, 1)),
        )

    def make_camera(self):
        turn = np.diag([1.0, -1.0, -1.0])
        return self.it.Camera(K=[[18, 0, 11.5], [0, 18, 11.5], [0, 0, 1]], R=turn, t=-turn @ [0.5, 0.5, 1.0], size=(24, 24))

    def make_photograph(self):
        ramp = np.linspace(0.2, 0.8, 24 * 24 * 3).reshape(24, 24, 3)
        return self.it.Photograph(camera=self.camera, picture=ramp.astype(np.float32), name="front")

    def make_uv(self):
        return self.it.parameterize(self.square, device="cpu")

    def make_binding(self):
        return self.it.bind_photographs(self.square, [self.photograph], background=None, device="cpu")

    def make_texture(self):
        made = self.it.combine_photographs(self.square, self.uv, [self.photograph], 32, background=None, device="cpu")
        known = made.known.copy()
        known[14:17, 14:17] = False
        return dataclasses.replace(made, known=known)

    def make_lights(self):
        return np.array([self.it.light_direction(t, 45) for t in (0, 90, 180, 270)])

    def make_stack(self):
        values = np.random.default_rng(0).uniform(0.2, 0.8, (4, 16, 16, 1)).astype(np.float32)
        return self.it.PhotometricStack(values, self.lights)

    def make_many(self):
        lights = np.array([self.it.light_direction(t, s) for s in (20, 50) for t in range(0, 360, 60)])
        values = np.random.default_rng(0).uniform(0.2, 0.8, (12, 8, 8, 3)).astype(np.float32)
        return self.it.PhotometricStack(values, lights)

    def make_relightable(self):
        return self.it.represent(self.stack, "gradient", device="cpu")

    def make_swatch(self):
        y, x = np.mgrid[:16, :16]
        return self.it.geometry_from_height(np.sin(2 * np.pi * x / 8) + np.cos(2 * np.pi * y / 8))

    def make_sample(self):
        return np.random.default_rng(1).random((24, 24))

    def make_material(self):
        ramp = np.linspace(0, 1, 256, dtype=np.float32).reshape(16, 16)
        return self.it.Material({"roughness": ramp}, {"roughness": "wood_roughness.png"}, {"roughness": 8})

    def make_synthesis(self):
        return self.it.quilt(self.sample, 32, block=8, device="cpu")

    def make_ramp(self):
        return np.tile(np.linspace(0, 1, 24), (24, 1)) + 0.1 * np.sin(np.arange(24))[:, None]

    def make_hole(self):
        hole = np.zeros((24, 24), bool)
        hole[9:13, 9:13] = True
        return hole

    def make_relief_report(self):
        return self.it.assess_relief(self.completed, truth=self.sheet, device="cpu")

    def make_wall(self):
        corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        return {"vertices": corners, "faces": np.array([[0, 1, 2], [0, 2, 3]], np.int32)}

    def make_wall_uv(self):
        return {**self.wall, "uv": self.wall["vertices"][:, :2] / 2 + 0.5}

    def make_viewpoint(self):
        return self.render.Viewpoint((0.0, 0.0, 5.0), (0.0, 0.0, 0.0))

    def make_bsdf(self):
        return self.render.matte_bsdf(np.zeros((4, 4, 3)) + [0, 0.6, 0.8], np.full((4, 4, 1), 0.5))

    def make_files(self):
        """A folder with one file of each kind that is read."""
        it, folder = self.it, Path(tempfile.mkdtemp(prefix="api-attack-"))
        self.square.write(folder / "mesh.ply")
        (folder / "guides.txt").write_text("0 0 0\n1 0 0\n")
        it.write_image(np.linspace(0, 1, 256).reshape(16, 16), folder / "image.png")
        it.write_exr({"Y": np.linspace(0, 1, 64, dtype=np.float32).reshape(8, 8)}, folder / "image.exr")
        it.write_points(self.swatch.points, folder / "points.ply")
        it.write_relightable(self.relightable, folder / "texture.exr")
        (folder / "ranks.csv").write_text("observer,a,b,c\n1,1,2,3\n2,1,3,2\n3,1,2,3\n")
        lines = ["4"]
        for k, light in enumerate(self.stack.lights):
            it.write_image(self.stack.image(k)[:, :, 0], folder / f"{k}.png")
            lines.append(f"{k}.png " + " ".join(f"{v:.9g}" for v in light))
        (folder / "capture.lp").write_text("\n".join(lines) + "\n")
        it.write_image(self.photograph.image, folder / "front.png")
        camera = {"K": self.camera.K.tolist(), "R": self.camera.R.tolist(), "t": self.camera.t.tolist()}
        (folder / "cameras.json").write_text(json.dumps({"front.png": camera}))
        (folder / "wood").mkdir()
        self.material.write(folder / "wood")
        return folder

    # Valid calls.

    def calls(self):
        """Return the valid calls by name: function, arguments by name. Values are made when a name is asked for."""
        it, r = (lambda name: getattr(self.it, name)), (lambda name: getattr(self.render, name))
        cpu = {"device": "cpu"}
        quiet = {"progress": lambda *_: None}
        restoring = {"kappa": 4, "levels": 1, "coherence": 10.0, "orientations": 1, "refine": 0, "seed": 0, "seams": True}
        fitting = {
            "robust": False, "order": 2, "interpolation": "auto", "components": None, "smoothing": None,
            "integration": "fourier", "differentiation": "fourier",
        }  # fmt: skip
        view = {"size": (8, 8), "samples": 1, "seed": 0}
        files = lambda name: self.files / name  # noqa: E731
        base_of = {
            "Plane": lambda: self.it.Plane(point=(0, 0, 2), normal=(0, 0, 5)),
            "Cylinder": lambda: self.it.Cylinder(point=(0, 0, 0), axis=(0, 0, 1), radius=2.0),
            "Sphere": lambda: self.it.Sphere(center=(0, 0, 0), radius=2.0),
            "SmoothBase": lambda: self.it.SmoothBase(
                vertices=self.square.vertices, faces=self.square.faces, normals=self.square.normal, relief_scale=1.0, device="cpu"
            ),
        }
        points = np.array([[0.2, 0.4, 0.5], [0.6, 0.1, 3.0]])
        relief = {"spacing": None, "extent": "holes", "holes": None, **cpu}
        synthesis = {"tileable": False, "mask": np.ones((24, 24), bool), "match": None, "seed": 0, **cpu, **quiet}
        calls = {
            "Surface": lambda: (it("Surface"), fields(self.completed)),
            "Surface.write": lambda: (self.square.write, {"path": "out.ply", "overwrite": True}),
            "Surface.part": lambda: (self.square.part, {"keep": np.array([True, False, True, True])}),
            "Plane": lambda: (it("Plane"), {"point": (0, 0, 2), "normal": (0, 0, 5), "direction": (1, 0, 0), "inward": False,
                                            "fit": None}),
            "Cylinder": lambda: (it("Cylinder"), {"point": (0, 0, 0), "axis": (0, 0, 1), "radius": 2.0, "inward": False,
                                                  "fit": None}),
            "Sphere": lambda: (it("Sphere"), {"center": (0, 0, 0), "radius": 2.0, "inward": False, "fit": None}),
            "SmoothBase": lambda: (it("SmoothBase"), {"vertices": self.square.vertices, "faces": self.square.faces,
                                                      "normals": self.square.normal, "relief_scale": 1.0, **cpu,
                                                      "inward": False, "fit": None}),
            **{f"{kind}.foot": lambda make=make: (make().foot, {"points": points}) for kind, make in base_of.items()},
            **{f"{kind}.distance": lambda make=make: (make().distance, {"points": points}) for kind, make in base_of.items()},
            **{f"{kind}.describe": lambda make=make: (make().describe, {"unit_name": "mm"}) for kind, make in base_of.items()},
            **{f"{kind}.chart": lambda make=make: (make().chart, {"points": points})
               for kind, make in base_of.items() if kind in ("Plane", "Cylinder")},
            **{f"{kind}.from_chart": lambda make=make: (make().from_chart, {"coordinates": points[:, :2]})
               for kind, make in base_of.items() if kind in ("Plane", "Cylinder")},
            "read_surface": lambda: (it("read_surface"), {"path": files("mesh.ply"), "view": (0, 0, -1), "strict": False}),
            "mend_surface": lambda: (it("mend_surface"), {"surface": self.square, "strict": False}),
            "write_surface": lambda: (it("write_surface"), {"surface": self.square, "path": "out.ply", "overwrite": True}),
            "surface_from_points": lambda: (it("surface_from_points"), {
                "points": self.sheet.vertices, "direction": (0, 0, -1), "color": np.full((100, 3), 0.5), "longest": 3.0}),
            "surface_from_range_image": lambda: (it("surface_from_range_image"), {
                "points": self.grid, "view": (6, 6, 100.0), "color": np.full((12, 12, 3), 0.5), "steepest": 80.0}),
            "fit_base": lambda: (it("fit_base"), {"points": self.sheet.vertices, "kinds": ("plane",)}),
            "read_guides": lambda: (it("read_guides"), {"path": files("guides.txt")}),
            "list_holes": lambda: (it("list_holes"), {"surface": self.scan}),
            "complete_relief": lambda: (it("complete_relief"), {
                "surface": self.scan, "base": "plane", "window": 2, "rotations": 1, "refine": 0,
                "color_weight": None, **relief, "exemplar": "near", "guides": "auto", "symmetry": "auto",
                "seed": 0, **quiet}),
            "prepare_relief": lambda: (it("prepare_relief"), {
                "surface": self.scan, "base": "plane", **relief, "hole_size": None, "relief_scale": None, "frames": None,
                "reference": None, "near": True}),
            "PreparedRelief.complete": lambda: (it("prepare_relief")(self.scan, "plane", extent="holes", **cpu).complete, {
                "settings": self.it.ReliefSettings(window=2, rotations=1),
                "exemplar": np.ones(len(self.scan.vertices), bool), "guides": "auto", "seed": 0, "memory": None, **quiet}),
            "PreparedRelief.candidates": lambda: (it("prepare_relief")(self.scan, "plane", extent="holes", **cpu).candidates, {
                "count": 2, "settings": self.it.ReliefSettings(window=2, rotations=1),
                "exemplar": np.ones(len(self.scan.vertices), bool), "guides": "auto", "seed": 0, "memory": None, **quiet}),
            "write_candidates_report": lambda: (it("write_candidates_report"), {
                "candidates": [self.completed], "path": files("c.html"), "truth": self.sheet, "title": "t", "scan": self.scan,
                "size": 8, **cpu}),
            "PreparedRelief": lambda: (it("PreparedRelief"), fields(
                self.it.prepare_relief(self.scan, "plane", extent="holes", **cpu))),
            "ReliefSettings": lambda: (it("ReliefSettings"), fields(self.it.ReliefSettings(window=2, error=1.0))),
            "Selection": lambda: (it("Selection"), fields(self.it.Selection())),
            "Hole": lambda: (it("Hole"), fields(self.it.list_holes(self.scan)[1])),
            "assess_relief": lambda: (it("assess_relief"), {"surface": self.completed, "truth": self.sheet, **cpu}),
            "ReliefReport": lambda: (it("ReliefReport"), fields(self.relief_report)),
            "TruthComparison": lambda: (it("TruthComparison"), fields(self.relief_report.truth)),
            "write_relief_report": lambda: (it("write_relief_report"), {
                "surface": self.completed, "path": "report.html", "report": self.relief_report, "truth": self.sheet,
                "title": "Title", "scan": self.completed.part(self.completed.measured), "extra": ("a line",), "size": 16, **cpu,
                "pictures": None}),
            # Images and files.
            "read_image": lambda: (it("read_image"), {"path": files("image.png"), "linear": None, "orient": True}),
            "read_exr": lambda: (it("read_exr"), {"path": files("image.exr"), "part": None}),
            "write_image": lambda: (it("write_image"), {
                "image": np.linspace(0, 1, 8 * 9 * 3).reshape(8, 9, 3), "path": "out.png", "bits": 8, "linear": None,
                "quality": 95}),
            "write_image 16": lambda: (it("write_image"), {
                "image": np.linspace(0, 1, 8 * 9).reshape(8, 9), "path": "out.png", "bits": 16, "linear": True, "quality": 95}),
            "write_image exr": lambda: (it("write_image"), {
                "image": np.linspace(0, 1, 8 * 9 * 3).reshape(8, 9, 3), "path": "out.exr", "linear": True}),
            "write_image jpg": lambda: (it("write_image"), {
                "image": np.linspace(0, 1, 8 * 9 * 3).reshape(8, 9, 3), "path": "out.jpg", "quality": 95}),
            "write_exr": lambda: (it("write_exr"), {
                "channels": {"Y": np.linspace(0, 1, 72).reshape(8, 9)}, "path": "out.exr", "metadata": {"said": "word"}}),
            # Photometric.
            "light_direction": lambda: (it("light_direction"), {"tilt": 30.0, "slant": 45.0}),
            "tilt_and_slant": lambda: (it("tilt_and_slant"), {"lights": self.lights}),
            "PhotometricStack": lambda: (it("PhotometricStack"), {
                **fields(self.stack), "mask": np.ones((16, 16), bool), "names": ("a", "b", "c", "d"), "ceiling": 1.0}),
            "PhotometricStack ceilings": lambda: (it("PhotometricStack"), {
                **fields(self.stack), "ceiling": np.ones((4, 1)), "images": np.asarray(self.stack.images)}),
            "PhotometricStack.name": lambda: (self.stack.name, {"k": 1}),
            "PhotometricStack.image": lambda: (self.stack.image, {"k": 1}),
            "PhotometricStack.mixed": lambda: (self.stack.mixed, {"weights": (1.0,)}),
            "PhotometricStack.subset": lambda: (self.stack.subset, {"indices": np.array([0, 1, 2])}),
            "PhotometricStack.strips": lambda: (lambda size: list(self.stack.strips(size)), {"size": 8}),
            "read_stack": lambda: (it("read_stack"), {
                "path": files("capture.lp"), "response": None, "mask": None, "intensities": None, "sphere": None, "circle": None,
                "gray": False, "memory": 1 << 30, "keep": (), "skip": (), "strict": False}),
            "represent": lambda: (it("represent"), {"stack": self.stack, "kind": "gradient", "color": "channels", **fitting,
                                                    **cpu, **quiet}),
            "represent rbf": lambda: (it("represent"), {"stack": self.many, "kind": "rbf", "color": "channels", **fitting,
                                                        **cpu, **quiet}),
            "assess_representation": lambda: (it("assess_representation"), {
                "stack": self.stack, "kind": "gradient", "leave_one_out": False, **fitting, **cpu, **quiet}),
            "RepresentationReport": lambda: (it("RepresentationReport"), fields(
                self.it.assess_representation(self.stack, "gradient", **cpu))),
            "Relightable": lambda: (it("Relightable"), {
                **fields(self.relightable), "mask": np.ones((16, 16), bool), "height": np.zeros((16, 16)),
                "confidence": np.ones((16, 16)), "chroma": np.ones((16, 16, 3))}),
            "Relightable.coefficients": lambda: (self.relightable.coefficients, {"light": (0, 0.6, 0.8)}),
            "Relightable.relight": lambda: (self.relightable.relight, {"light": (0, 0.6, 0.8), "clip": True, **cpu}),
            "read_relightable": lambda: (it("read_relightable"), {"path": files("texture.exr")}),
            "write_relightable": lambda: (it("write_relightable"), {"texture": self.relightable, "path": "out.exr"}),
            "write_gltf": lambda: (it("write_gltf"), {"texture": self.relightable, "path": "out.glb"}),
            "write_maps": lambda: (it("write_maps"), {"texture": self.relightable, "folder": "out"}),
            "write_web_planes": lambda: (it("write_web_planes"), {
                "texture": self.relightable, "path": "info.json", "tiles": False, "quality": 95}),
            "surface_maps": lambda: (it("surface_maps"), {"texture": self.relightable}),
            "SurfaceMaps": lambda: (it("SurfaceMaps"), fields(self.it.surface_maps(self.relightable))),
            "height_of": lambda: (it("height_of"), {
                "texture": self.relightable, "maps": self.it.surface_maps(self.relightable), "method": "cosine"}),
            "gradients_from_height": lambda: (it("gradients_from_height"), {
                "z": self.sample, "method": "fourier", "slope": (0.1, 0.2)}),
            "height_from_gradients": lambda: (it("height_from_gradients"), {
                "p": self.sample, "q": self.sample.T, "method": "fourier"}),
            "integrability": lambda: (it("integrability"), {"p": self.sample, "q": self.sample.T}),
            "Integrability": lambda: (it("Integrability"), fields(self.it.integrability(self.sample, self.sample.T))),
            "fit_circle": lambda: (it("fit_circle"), {"image": disc()}),
            "lights_from_sphere": lambda: (it("lights_from_sphere"), {
                "images": [ball()], "circle": (31.5, 31.5, 28), "outline": None}),
            "lights_from_sphere outline": lambda: (it("lights_from_sphere"), {
                "images": [ball()], "circle": None, "outline": disc()}),
            "SphereLights": lambda: (it("SphereLights"), fields(self.it.lights_from_sphere([ball()], (31.5, 31.5, 28)))),
            # Synthesis.
            "quilt": lambda: (it("quilt"), {
                "maps": self.sample, "size": 30, "block": 8, "overlap": 2, "tolerance": 0.1, "cut": "path",
                "continuation": "shortcut", "refine": 0, **synthesis}),
            "even_light": lambda: (it("even_light"), {
                "image": np.abs(self.ramp), "radius": 4.0, "mask": np.ones((24, 24), bool)}),
            "EvenLight": lambda: (it("EvenLight"), fields(self.it.even_light(np.abs(self.ramp)))),
            "weave": lambda: (it("weave"), {
                "maps": self.sample, "size": 30, "block": 8, "passes": 1, "exact": False, **synthesis}),
            "grow": lambda: (it("grow"), {
                "maps": self.sample, "size": 28, "missing": None, "window": 1, "levels": 1, "exhaustive": 1.0, **synthesis}),
            "grow missing": lambda: (it("grow"), {
                "maps": self.ramp, "missing": self.hole, "window": 1, "levels": 1, **cpu}),
            "synthesize": lambda: (it("synthesize"), {
                "source": self.sample, "size": 28, "options": self.it.QuiltOptions(block=8), "kind": "gradient",
                "color": "channels", "robust": False, **synthesis}),
            "synthesize_each_light": lambda: (it("synthesize_each_light"), {
                "source": self.stack, "size": 18, "lights": self.lights[:1], "options": self.it.QuiltOptions(block=6),
                "kind": "gradient", "color": "channels", "robust": False, **synthesis, "mask": None}),
            "WeaveOptions": lambda: (it("WeaveOptions"), fields(self.it.WeaveOptions())),
            "QuiltOptions": lambda: (it("QuiltOptions"), fields(self.it.QuiltOptions())),
            "GrowOptions": lambda: (it("GrowOptions"), fields(self.it.GrowOptions())),
            "Match": lambda: (it("Match"), {"maps": self.sample, "weights": (1.0,), "metric": "absolute"}),
            "read_material": lambda: (it("read_material"), {"folder": files("wood")}),
            "Material": lambda: (it("Material"), {**fields(self.material), "opaque": np.ones((16, 16), bool)}),
            "Material.with_values": lambda: (self.material.with_values, {"values": np.full((8, 8, 1), 0.5)}),
            "Material.write": lambda: (self.material.write, {"folder": "out"}),
            "Synthesis": lambda: (it("Synthesis"), fields(self.synthesis)),
            "Synthesis.copy_of": lambda: (self.synthesis.copy_of, {"sample": self.sample}),
            "assess_synthesis": lambda: (it("assess_synthesis"), {
                "sample": self.sample, "result": self.synthesis, "mask": np.ones((24, 24), bool), "lights": None}),
            "SynthesisReport": lambda: (it("SynthesisReport"), fields(self.it.assess_synthesis(self.sample, self.synthesis))),
            "friedman": lambda: (it("friedman"), {"ranks": [[1, 2, 3], [1, 2, 3], [1, 3, 2], [1, 2, 3]]}),
            "Friedman": lambda: (it("Friedman"), fields(self.it.friedman([[1, 2, 3], [1, 2, 3], [1, 3, 2]]))),
            "multiple_comparison": lambda: (it("multiple_comparison"), {"ranks": [[1, 2, 3]] * 6, "alpha": 0.05}),
            "MultipleComparison": lambda: (it("MultipleComparison"), fields(self.it.multiple_comparison([[1, 2, 3]] * 6, 0.05))),
            "read_ranks": lambda: (it("read_ranks"), {"paths": [files("ranks.csv")], "methods": None}),
            # Restoration.
            "restore": lambda: (it("restore"), {
                "image": self.ramp, "missing": self.hole, "method": "split", **restoring, "barriers": None,
                "inside": np.ones((24, 24), bool), **cpu, **quiet}),
            "assess_restoration": lambda: (it("assess_restoration"), {
                "image": tiles(), "missing": block(), "truth": tiles()}),
            "Restoration": lambda: (it("Restoration"), fields(self.it.restore(self.ramp, self.hole, "inpaint", **cpu))),
            "RestorationReport": lambda: (it("RestorationReport"), fields(
                self.it.assess_restoration(tiles(), block(), tiles()))),
            # Parameterization and photographs.
            "parameterize": lambda: (it("parameterize"), {
                "surface": self.square, "energy": "stretch", "boundary": "free", "view": (0, 0, -1), "importance": 1.5,
                "shape_threshold": 0.0, "max_stretch": None, "conformal": 0.5, "iterations": 3, **cpu, **quiet}),
            "Parameterization": lambda: (it("Parameterization"), fields(self.uv)),
            "Camera": lambda: (it("Camera"), fields(self.camera)),
            "Camera.unproject": lambda: (self.camera.unproject, {"pixel": np.array([[3.0, 4.0], [11.5, 11.5]])}),
            "Camera.project": lambda: (self.camera.project, {"points": self.square.vertices}),
            "Photograph": lambda: (photograph, {**fields(self.photograph)}),
            "bind_photographs": lambda: (it("bind_photographs"), {
                "surface": self.square, "photographs": [self.photograph], "background": None, "background_threshold": 0.06,
                "grazing": 80.0, **cpu, **quiet}),
            "Binding": lambda: (it("Binding"), fields(self.binding)),
            "Binding.common": lambda: (self.binding.common, {"faces": self.square.faces}),
            "Binding.triangle_class": lambda: (self.binding.triangle_class, {"faces": self.square.faces}),
            "combine_photographs": lambda: (it("combine_photographs"), {
                "surface": self.square, "uv": self.uv, "photographs": [self.photograph], "size": 16, "select": "best",
                "blend": "spline", "exposure": True, "background": None, "background_threshold": 0.06, "grazing": 80.0, **cpu,
                **quiet}),
            "combine_photographs bound": lambda: (it("combine_photographs"), {
                "surface": self.square, "uv": self.uv, "photographs": [self.photograph], "size": 16, "binding": self.binding,
                **cpu}),
            "Texture": lambda: (it("Texture"), fields(self.texture)),
            "border_step": lambda: (it("border_step"), {"texture": self.texture}),
            "compare_with_photograph": lambda: (it("compare_with_photograph"), {
                "surface": self.square, "uv": self.uv, "image": np.asarray(self.texture.image, np.float32),
                "known": np.ones(self.texture.known.shape, bool), "photograph": self.photograph, "reduce": 1, "samples": 1,
                "seed": 0}),
            "ViewComparison": lambda: (it("ViewComparison"), fields(self.it.compare_with_photograph(
                self.square, self.uv, self.texture.image, np.ones(self.texture.known.shape, bool), self.photograph, samples=1))),
            "read_photographs": lambda: (it("read_photographs"), {
                "path": files("cameras.json"), "images": None, "strict": False}),
            "restore_texture": lambda: (it("restore_texture"), {
                "texture": self.texture, "method": "split", **restoring, **cpu, **quiet}),
            "write_textured": lambda: (it("write_textured"), {
                "surface": self.square, "uv": self.uv, "texture": self.texture, "path": "out.glb"}),
            # Geometry.
            "geometry_from_height": lambda: (it("geometry_from_height"), {
                "height": heights(), "pixel": 1.0, "spacing": None, "bounds": np.asarray(self.swatch.bounds), "seed": 0}),
            "geometry_from_mesh": lambda: (it("geometry_from_mesh"), {
                "vertices": self.sheet.vertices, "faces": self.sheet.faces, "color": np.full((100, 3), 0.5), "spacing": 0.5,
                "bounds": None, "axis": 2, "seed": 0}),
            "geometry_from_points": lambda: (it("geometry_from_points"), {
                "points": self.swatch.points.points, "normals": self.swatch.points.normals,
                "color": np.full((len(self.swatch.points), 3), 0.5), "bounds": np.asarray(self.swatch.bounds), "axis": 2,
                "spacing": 1.0}),
            "read_geometry_texture": lambda: (it("read_geometry_texture"), {
                "path": files("points.ply"), "bounds": None, "axis": None, "spacing": None, "height": None, "pixel": None,
                "seed": 0}),
            "GeometryTexture": lambda: (it("GeometryTexture"), fields(self.swatch)),
            "PointSet": lambda: (it("PointSet"), {
                "points": np.eye(3), "normals": np.eye(3), "color": np.full((3, 3), 0.5), "source": np.arange(3),
                "moved": np.zeros(3), "patch": np.arange(3), "notes": ("a",)}),
            "PointSet.part": lambda: (self.it.PointSet(np.eye(3), np.eye(3)).part, {"chosen": np.array([True, False, True])}),
            "PointSet.write": lambda: (self.it.PointSet(np.eye(3), np.eye(3)).write, {"path": "out.ply"}),
            "write_points": lambda: (it("write_points"), {"points": self.swatch.points, "path": "out.xyz"}),
            "extend_geometry": lambda: (it("extend_geometry"), {
                "texture": self.swatch, "size": 20.0, "patch": 8.0, "overlap": None, "extra": None, "cell": None,
                "tolerance": 0.1, "max_error": None, "fit": self.it.PatchFit(weights="weave", pairs=20), "relax": 1,
                "tileable": False, "seed": 0, **cpu, **quiet}),
            "assess_geometry": lambda: (it("assess_geometry"), {"points": self.swatch.points, "texture": self.swatch, **cpu}),
            "GeometryReport": lambda: (it("GeometryReport"), fields(
                self.it.assess_geometry(self.swatch.points, self.swatch, **cpu))),
            "mesh_geometry": lambda: (it("mesh_geometry"), {
                "points": self.swatch.points, "cell": None, "closed": False, "axis": 2, **cpu}),
            "wrap_geometry": lambda: (it("wrap_geometry"), {
                "points": self.swatch.points, "vertices": 32 * self.square.vertices, "faces": self.square.faces,
                "uv": self.square.vertices[:, :2], "size": 16.0, "repeat": (1, 1), "axis": 2, "thickness": None, "base": None,
                "normals": self.square.normal, **cpu}),
            "PairingWeights": lambda: (it("PairingWeights"), fields(self.it.PairingWeights(2.0, 15.0, 6.0, 5.0))),
            "PatchFit": lambda: (it("PatchFit"), fields(self.it.PatchFit())),
            # Rendering.
            "render.compare": lambda: (r("compare"), {"image": self.ramp, "reference": self.ramp[::-1].copy()}),
            "render.Comparison": lambda: (r("Comparison"), fields(self.render.compare(self.ramp, self.ramp[::-1].copy()))),
            "render.frame": lambda: (r("frame"), {
                "vertices": self.wall["vertices"], "direction": (0, 0, 1), "up": (0.0, 1.0, 0.0), "fov": 25.0, "margin": 1.1}),
            "render.Viewpoint": lambda: (r("Viewpoint"), fields(self.viewpoint)),
            "render.Light": lambda: (r("Light"), fields(self.render.Light())),
            "render.Gloss": lambda: (r("Gloss"), fields(self.render.Gloss())),
            "render.Variant": lambda: (r("Variant"), fields(self.render.variant())),
            "render.RangeImage": lambda: (r("RangeImage"), fields(
                self.render.range_scan(**self.wall, camera=self.viewpoint, size=(8, 8)))),
            "render.height_normals": lambda: (r("height_normals"), {"height": self.sample}),
            "render.lit_texture": lambda: (r("lit_texture"), {
                **self.wall_uv, "image": np.full((4, 4, 3), 0.5), "camera": self.viewpoint, **view, "background": 1.0}),
            "render.matte_bsdf": lambda: (r("matte_bsdf"), {
                "normal": np.zeros((4, 4, 3)) + [0, 0.6, 0.8], "albedo": np.full((4, 4, 1), 0.5)}),
            "render.photometric_capture": lambda: (r("photometric_capture"), {
                "height": np.zeros((5, 9)), "albedo": np.full((4, 8), 0.5), "lights": [[0, 0, 1.0]], "size": (4, 8),
                "gloss": None, "shadows": True, "bounces": 0, "samples": 1, "seed": 0, **quiet}),
            "render.range_scan": lambda: (r("range_scan"), {
                **self.wall, "camera": self.viewpoint, "size": (8, 8), "noise": 0.0, "steepest": 75.0, "seed": 0}),
            "render.relightable_bsdf": lambda: (shown_bsdf, {
                "maps": np.linspace(0, 1, 48).reshape(3, 4, 4, 1), "coefficients": lambda x, y, z, maths: [x, y, z],
                "chroma": np.ones((4, 4, 3)), "repeat": (1.0, 1.0), "tiled": True, "smooth": True, "back": False}),
            "render.relit": lambda: (r("relit"), {
                **self.wall_uv, "bsdf": self.bsdf, "camera": self.viewpoint, "light": (0, 0, 1.0), **view, "background": 0.0}),
            "render.relit_plane": lambda: (r("relit_plane"), {
                "bsdf": self.bsdf, "size": (4, 4), "light": (0, 0.6, 0.8), "samples": 1, "seed": 0, "facing": True}),
            "render.through_camera": lambda: (r("through_camera"), {
                "vertices": np.array([[-9.0, -9, 5], [9, -9, 5], [9, 9, 5], [-9, 9, 5]]), "faces": self.wall["faces"],
                "uv": self.wall_uv["uv"], "image": np.full((4, 4, 3), 0.25),
                "matrix": np.array([[8.0, 0, 3.5], [0, 8.0, 3.5], [0, 0, 1]]), "turn": np.eye(3), "shift": np.zeros(3), **view,
                "lights": [(np.array([0.0, 0, -1]), 0.5)], "ambient": 0.5}),
            "render.view": lambda: (r("view"), {
                **self.wall, "camera": self.viewpoint, "colors": np.full((4, 3), 0.5), "light": self.render.Light(), **view,
                "albedo": (0.55, 0.5, 0.45), "background": 1.0, "flat": False}),
        }  # fmt: skip
        return calls


def fields(instance):
    """Return the fields that a dataclass is made from."""
    return {f.name: getattr(instance, f.name) for f in dataclasses.fields(instance) if f.init}


def photograph(**given):
    """Make a photograph and read it, since it may be read each time it is needed only."""
    import intaglio

    made = intaglio.Photograph(**given)
    return made, made.read()


def shown_bsdf(**given):
    """Make a material and look at it."""
    import intaglio.render

    return intaglio.render.relit_plane(intaglio.render.relightable_bsdf(**given), (4, 4), (0, 0.6, 0.8))


def disc():
    y, x = np.mgrid[:64, :64]
    return np.where(np.hypot(x - 31.5, y - 31.5) < 20, 0.8, 0.1)


def ball():
    picture = np.full((64, 64), 0.1)
    picture[31:33, 41:43] = 1.0
    return picture


def heights():
    y, x = np.mgrid[:16, :16]
    return np.sin(2 * np.pi * x / 8) + np.cos(2 * np.pi * y / 8)


def tiles():
    return np.tile([0.2, 0.4, 0.6, 0.4], (64, 16))


def block():
    missing = np.zeros((64, 64), bool)
    missing[24:40, 24:40] = True
    return missing


def parts(value, name="result", seen=None):
    """Give (name, leaf) of everything that a value holds."""
    seen = set() if seen is None else seen
    if isinstance(value, np.ndarray | str | bytes | int | float | complex | bool | np.generic | Path) or value is None:
        yield name, value
    elif id(value) in seen:
        return
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        seen.add(id(value))
        for f in dataclasses.fields(value):
            yield from parts(getattr(value, f.name, None), f"{name}.{f.name}", seen)
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from parts(item, f"{name}[{key}]", seen)
    elif isinstance(value, list | tuple):
        for number, item in enumerate(value):
            yield from parts(item, f"{name}[{number}]", seen)


def bits(value):
    """Return what tells a value from another of the same shape, to the last bit."""
    found = {}
    for name, leaf in parts(value):
        if isinstance(leaf, np.ndarray):
            found[name] = (leaf.shape, np.ascontiguousarray(leaf).tobytes() if leaf.dtype.kind in "biuf" else str(leaf))
        else:
            found[name] = repr(leaf.item() if isinstance(leaf, np.generic) else leaf)
    return found


def alike(value, other):
    """Return whether arrays differ by rounding alone: the renderer's threads add up a pixel's paths in any order."""
    return all(
        np.allclose(leaf, same, atol=1e-6, equal_nan=True) if isinstance(leaf, np.ndarray) else True
        for (_, leaf), (_, same) in zip(parts(value), parts(other), strict=True)
    )


def not_numbers(value):
    """Return the names of the parts that hold NaN."""
    found = set()
    for name, leaf in parts(value):
        array = np.asarray(leaf) if isinstance(leaf, np.ndarray | float | np.floating) else None
        if array is not None and array.dtype.kind == "f" and np.isnan(array).any():
            found.add(re.sub(r"\[\d+\]", "[]", name))
    return found


# Records of results may hold NaN where a figure has no meaning; nothing takes them.
RECORDS = {
    "ReliefReport", "TruthComparison", "RepresentationReport", "RestorationReport", "SynthesisReport", "GeometryReport",
    "ViewComparison", "Friedman", "MultipleComparison", "Integrability", "SphereLights", "Hole", "render.Comparison",
    "render.RangeImage", "SurfaceMaps",
    # NaN stands for what is not seen or masked out, and copies are what was given.
    "Match", "Camera.project", "render.range_scan", "Synthesis.copy_of",
}  # fmt: skip


def jobs_of(calls, name):
    """Return (argument, place inside it or None, bad) of all calls to be made of one function."""
    _, arguments = calls[name]()
    found = []
    for argument, valid in arguments.items():
        found += [(argument, None, bad) for bad in BAD]
        if isinstance(valid, dict) and valid:
            found += [(argument, next(iter(valid)), bad) for bad in BAD]
        elif isinstance(valid, list | tuple) and valid:
            found += [(argument, 0, bad) for bad in BAD]
    return found


class Worker:
    """What runs in a process of its own: valid calls once, then bad ones."""

    def __init__(self):
        import warp as wp

        wp.config.log_level = wp.LOG_WARNING
        self.table = Table()
        self.calls = self.table.calls()
        self.name = None

    def prepare(self, name):
        """Make the valid call; what it gives is what others are compared with."""
        if self.name == name:
            return
        resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        self.function, self.arguments = self.calls[name]()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self.expected = self.result(self.arguments)
        self.name = name
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MEMORY, resource.RLIM_INFINITY))

    def result(self, arguments):
        """Return what the function returns and the files that it writes into an empty folder."""
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            with contextlib.redirect_stdout(io.StringIO()):
                returned = self.function(**arguments)
            files = {str(p.relative_to(folder)): p.read_bytes() for p in sorted(Path(folder).rglob("*")) if p.is_file()}
            os.chdir("/")
        return returned, files

    def attack(self, name, argument, place, bad):
        """Make one call; return what is wrong, or None, and whether the call was accepted."""
        self.prepare(name)
        make, judged = BAD[bad]
        valid = self.arguments[argument]
        held = valid if place is None else valid[place]
        try:
            value = make(held)
        except (ValueError, TypeError, OverflowError, FloatingPointError):
            return None, "not made"
        genuine = array_like(held)
        is_same = (
            judged == "same" and shape_of(held) == genuine.shape and genuine.ndim > 0 and np.asarray(held).dtype == genuine.dtype
        )
        given = {**self.arguments, argument: value if place is None else inside(valid, place, value)}
        before = bits({k: v for k, v in given.items() if isinstance(v, np.ndarray | list | tuple | dict)})
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always")
            try:
                returned = self.result(given)
            except Exception as error:
                return self.judge_error(error, argument, value, self.arguments), "refused"
        said = [w for w in heard if w.category.__module__.partition(".")[0] != "intaglio"]
        if said:
            return f"warning: {said[0].category.__name__}: {said[0].message}", "accepted"
        if bits({k: v for k, v in given.items() if isinstance(v, np.ndarray | list | tuple | dict)}) != before:
            return "the input was altered", "accepted"
        if judged == "refuse":
            return f"{bad} array accepted", "accepted"
        if is_same and bits(returned) != bits(self.expected):
            wrong = [k for k, v in bits(self.expected).items() if bits(returned).get(k) != v]
            if not (name.startswith("render.") and alike(returned, self.expected)):
                return f"other bits: {wrong[:4]}", "accepted"
        if name not in RECORDS:
            worse = not_numbers(returned) - not_numbers(self.expected)
            if worse:
                return f"NaN in {sorted(worse)[:4]}", "accepted"
        return None, "accepted"

    @staticmethod
    def judge_error(error, argument, value, others):
        import intaglio

        text = str(error)
        kind = type(error).__name__
        if not isinstance(error, intaglio.IntaglioError | TypeError | ValueError) or isinstance(error, UnicodeError):
            return f"{kind}: {text[:150]}"
        if "\n" in text.strip():
            return f"several lines: {kind}: {text[:150]!r}"
        if len(text) > 2000:
            return f"{len(text)} characters: {kind}: {text[:100]!r}"
        if re.search(rf"\b{re.escape(argument)}\b", text):
            return None
        # Of two arrays that don't fit together either may be named.
        fitting = isinstance(value, np.ndarray) and value.dtype.kind in "biuf" and isinstance(error, intaglio.IntaglioError)
        if fitting and any(re.search(rf"\b{re.escape(other)}\b", text) for other in others):
            return None
        names = value if isinstance(value, tuple | list) else (value,)
        files = [str(name)[:50].replace("\0", " ") for name in names if isinstance(name, str | Path) and str(name)]
        if isinstance(error, intaglio.IntaglioError) and any(name in text for name in files):
            return None
        return f"without the name: {kind}: {text[:150]}"


def serve():
    """Answer attacks, one a line, until the input ends."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    worker = Worker()
    for line in sys.stdin:
        name, argument, place, bad = json.loads(line)
        try:
            if argument is None:
                worker.prepare(name)
                answer = jobs_of(worker.calls, name)
            else:
                answer = worker.attack(name, argument, place, bad)
        except BaseException as error:
            answer = [f"the engine failed: {type(error).__name__}: {str(error)[:300]}", "failed"]
        print(json.dumps(answer), file=answers, flush=True)


class Process:
    """A worker, started again after a crash or a hang."""

    def __init__(self, command=(__file__, "--serve")):
        self.command = [sys.executable, *command]
        self.process = None

    def ask(self, request, seconds, started=WARM_SECONDS):
        """Return the answer, or what ended the process; one that has to be started gets some time more."""
        if self.process is None:
            self.process = subprocess.Popen(
                self.command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
            )
            seconds += started
        self.process.stdin.write(json.dumps(request).encode() + b"\n")
        self.process.stdin.flush()
        if not select.select([self.process.stdout], [], [], seconds)[0]:
            self.close()
            return [f"hangs: more than {seconds:g} s", "hung"]
        line = self.process.stdout.readline()
        if not line:
            status = self.process.wait()
            self.close()
            return [f"crash: exit status {status}", "crashed"]
        return json.loads(line)

    def close(self):
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process.stdin.close()
            self.process.stdout.close()
            self.process = None


def attack(names, count=2, choose=lambda name, jobs: jobs, report=None):
    """Make the calls of all names in processes; return a list of (name, argument, place, bad, what is wrong or None, outcome)."""
    waiting = collections.deque(names)
    found = []

    def work():
        process = Process()
        while True:
            try:
                name = waiting.popleft()
            except IndexError:
                break
            jobs = process.ask((name, None, None, None), WARM_SECONDS)
            if jobs and isinstance(jobs[0], str):
                results = [(name, None, None, None, jobs[0], jobs[1])]
            else:
                results = []
                for argument, place, bad in choose(name, jobs):
                    results.append((name, argument, place, bad, *process.ask((name, argument, place, bad), SECONDS)))
            found.extend(results)
            if report is not None:
                report(name, results)
        process.close()

    threads = [threading.Thread(target=work) for _ in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return found


def public_names():
    """Return the parameters of all public functions, classes and methods that take any, by name."""
    import intaglio
    import intaglio.render

    found = {}

    def take(name, function):
        parameters = set(inspect.signature(function).parameters) - {"self"}
        if parameters:
            found[name] = parameters

    for prefix, module in (("", intaglio), ("render.", intaglio.render)):
        for name in module.__all__:
            value = getattr(module, name)
            if not inspect.isclass(value):
                if callable(value):
                    take(prefix + name, value)
            elif not issubclass(value, BaseException) and not inspect.isabstract(value):
                take(prefix + name, value)
                for method, function in vars(value).items():
                    if not method.startswith("_") and inspect.isfunction(function):
                        take(f"{prefix}{name}.{method}", function)
    return found


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--serve", action="store_true")
    options = parser.parse_args()
    if options.serve:
        serve()
        return 0
    names = list(Table().calls())
    if options.names:
        names = [n for n in names if any(re.fullmatch(pattern, n) for pattern in options.names)]

    def report(name, results):
        for _, argument, place, bad, wrong, _ in results:
            if wrong:
                print(f"{name}({argument}{'' if place is None else f'[{place}]'} = {bad}): {wrong}", flush=True)

    found = attack(names, options.jobs, report=report)
    outcomes = collections.Counter(outcome for *_, outcome in found)
    defects = sum(wrong is not None for *_, wrong, _ in found)
    print(f"{len(found)} calls of {len(names)} functions: {dict(outcomes)}; {defects} defects")
    return 1 if defects else 0


if __name__ == "__main__":
    sys.exit(main())
