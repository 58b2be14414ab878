"""Folders of material maps: which file is what, read by the meaning of its name, and written under the same names."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.checks import check_fields, checked_arguments
from intaglio.errors import FileError, InputError
from intaglio.files import READABLE_SUFFIXES, read_image_with_type, whole_folder, write_image
from intaglio.kernels.transfer import encode_srgb

# What maps are called by ambientCG, Poly Haven, Substance, Poliigon and others.
_WORDS = {
    "color": ("color", "colour", "basecolor", "albedo", "diffuse", "diff", "col"),
    "normal": ("normal", "normals", "nor", "nrm", "norm"),
    "roughness": ("roughness", "rough"),
    "gloss": ("gloss", "glossiness", "smoothness"),
    "displacement": ("displacement", "disp", "height", "depth"),
    "bump": ("bump",),
    "ao": ("ao", "ambientocclusion", "occlusion"),
    "metalness": ("metalness", "metallic", "metal"),
    "specular": ("specular", "spec"),
    "opacity": ("opacity", "alpha"),
    "emission": ("emission", "emissive"),
    "arm": ("arm", "orm"),
}
_KINDS = {word: kind for kind, words in _WORDS.items() for word in words}

# Maps whose values are colours as the eye sees them, stored as sRGB; all others are measures.
_COLORS = ("color", "specular", "emission")

# Words after a map's name that tell its variant, not its meaning.
_GL, _DX = ("gl", "ogl"), ("dx",)
_VARIANT = re.compile(r"\d+k|\d+|\d+bit|v\d+|var\d+|jpg|jpeg|png|tif|tiff|exr|map|maps|tex|texture|raw|srgb|linear")

# Files that make a folder one of photographs under known lights.
_LIGHTS = re.compile(r".*\.lp|light.*\.(csv|txt)")

# Normals that are this far from unit length have not only been rounded to 8 bits.
_OFF_UNIT = 0.02


@dataclass(frozen=True)
class Material:
    """Maps of one material, all of one size.

    `intaglio.weave`, `intaglio.quilt`, `intaglio.grow` and `intaglio.synthesize` take it as a sample.

    Attributes
    ----------
    maps : dict of str to (H, W) or (H, W, 3) float32 array
        Linear values by meaning: ``"color"``, ``"normal"``, ``"roughness"``, ``"gloss"``, ``"displacement"``, ``"bump"``,
        ``"ao"``, ``"metalness"``, ``"specular"``, ``"opacity"``, ``"emission"``, or ``"arm"`` (occlusion, roughness and metalness
        in the channels of one image). Normals are stored as (n + 1) / 2, their green upwards.
    files : dict of str to str
        Name of each map's file, under which `write` writes it.
    bits : dict of str to int
        Bits per channel of each map: 8, 16, or 32 for floats.
    opaque : (H, W) bool array, optional
        Pixels that are not transparent, if the colour map has alpha.
    notes : tuple of str
        What was chosen and mended, in words.

    Raises
    ------
    InputError
        If a meaning is unknown, a map has no file's name or bits, or maps differ in size.

    See Also
    --------
    intaglio.read_material : Reads one.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> ramp = np.tile(np.linspace(0, 1, 30, dtype=np.float32), (30, 1))
    >>> material = intaglio.Material({"roughness": ramp}, {"roughness": "wood_roughness.png"}, {"roughness": 8})
    >>> material.shape
    (30, 30)
    """

    maps: Mapping[str, Array]
    files: Mapping[str, str]
    bits: Mapping[str, int]
    opaque: Array | None = None
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        check_fields(self)
        if not self.maps or not self.maps.keys() == self.files.keys() == self.bits.keys():
            raise InputError("maps, files and bits of a material must have the same names, at least one")
        for kind, values in self.maps.items():
            if kind not in _WORDS:
                raise InputError(f"maps: {kind!r} is no known meaning; known: {', '.join(_WORDS)}")
            if values.ndim not in (2, 3) or values.size == 0 or values.shape[:2] != self.shape:
                raise InputError(f"maps: {kind} is {values.shape}; all maps must be (H, W) or (H, W, 3) of one size")
            if not np.isfinite(values).all():
                raise InputError(f"maps: {kind} has values that are not finite")

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the maps.

        Returns
        -------
        (int, int)
            Rows and columns in pixels.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> ramp = np.tile(np.linspace(0, 1, 30, dtype=np.float32), (30, 1))
        >>> material = intaglio.Material({"roughness": ramp}, {"roughness": "wood_roughness.png"}, {"roughness": 8})
        >>> material.shape
        (30, 30)
        """
        rows, columns = next(iter(self.maps.values())).shape[:2]
        return rows, columns

    @property
    def values(self) -> Array:
        """All maps one after another.

        Returns
        -------
        (H, W, n) float32 array
            The channels of the maps in their order.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> ramp = np.tile(np.linspace(0, 1, 30, dtype=np.float32), (30, 1))
        >>> material = intaglio.Material({"roughness": ramp}, {"roughness": "wood_roughness.png"}, {"roughness": 8})
        >>> material.values.shape
        (30, 30, 1)
        """
        return np.concatenate([_planes(m) for m in self.maps.values()], axis=2)

    @property
    def compared(self) -> Array:
        """What synthesis compares: the maps, colours as they are seen.

        Returns
        -------
        (H, W, n) float32 array
            Like `values`, with colours encoded as sRGB.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> ramp = np.tile(np.linspace(0, 1, 30, dtype=np.float32), (30, 1))
        >>> material = intaglio.Material({"roughness": ramp}, {"roughness": "wood_roughness.png"}, {"roughness": 8})
        >>> bool((material.compared == material.values).all())
        True
        """
        shown = [encode_srgb(m) if kind in _COLORS else m for kind, m in self.maps.items()]
        return np.concatenate([_planes(m) for m in shown], axis=2)

    @checked_arguments
    def with_values(self, values: Array) -> Material:
        """Return a material of the same maps with other values.

        Parameters
        ----------
        values : (H, W, n) array
            Channels in the order of `values`, such as the ``maps`` of a `Synthesis`.

        Returns
        -------
        Material
            Of the size of ``values``, with the same files' names.

        Raises
        ------
        InputError
            If the number of channels is another.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> ramp = np.tile(np.linspace(0, 1, 30, dtype=np.float32), (30, 1))
        >>> material = intaglio.Material({"roughness": ramp}, {"roughness": "wood_roughness.png"}, {"roughness": 8})
        >>> made = intaglio.quilt(material, 48, block=10, device="cpu")
        >>> material.with_values(made.maps).shape
        (48, 48)
        """
        counts = [_planes(m).shape[2] for m in self.maps.values()]
        if values.ndim != 3 or values.shape[2] != sum(counts):
            raise InputError(f"values must be (H, W, {sum(counts)}), not {values.shape}")
        parts = np.split(values, np.cumsum(counts)[:-1], axis=2)
        maps = {
            kind: np.ascontiguousarray(part if old.ndim == 3 else part[:, :, 0])
            for (kind, old), part in zip(self.maps.items(), parts, strict=True)
        }
        return replace(self, maps=maps, opaque=None)

    @checked_arguments
    def write(self, folder: PathLike) -> list[Path]:
        """Write the maps to a folder under their files' names, each with its bits.

        Parameters
        ----------
        folder : path
            Made if it is not there. Maps of the same names are replaced, all or none.

        Returns
        -------
        list of Path
            The images. What is not written as it was read is: WebP, TGA, BMP, JPEG 2000 become PNG; floats become EXR.

        Raises
        ------
        FileError
            If the folder can't be written to.

        Examples
        --------
        >>> import tempfile
        >>> import numpy as np
        >>> import intaglio
        >>> ramp = np.tile(np.linspace(0, 1, 30, dtype=np.float32), (30, 1))
        >>> material = intaglio.Material({"roughness": ramp}, {"roughness": "wood_roughness.png"}, {"roughness": 8})
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     [path.name for path in material.write(folder)]
        ['wood_roughness.png']
        """
        with whole_folder(folder) as beside:
            for kind, values in self.maps.items():
                name = _written_name(self.files[kind], self.bits[kind])
                bits = self.bits[kind] if Path(name).suffix.lower() in (".png", ".tif", ".tiff") else 8
                write_image(values, beside / name, bits=bits, linear=kind not in _COLORS)
        return [Path(folder) / _written_name(self.files[kind], self.bits[kind]) for kind in self.maps]


def _planes(values: Array) -> Array:
    return values[:, :, None] if values.ndim == 2 else values


def _written_name(name: str, bits: int) -> str:
    suffix = Path(name).suffix.lower()
    if bits == 32:
        return name if suffix == ".exr" else f"{Path(name).stem}.exr"
    if suffix in (".jpg", ".jpeg", ".jpe", ".jfif") and bits == 8:
        return name
    return name if suffix in (".png", ".tif", ".tiff") else f"{Path(name).stem}.png"


@dataclass(frozen=True)
class _File:
    """An image whose name tells what it holds."""

    path: Path
    kind: str
    convention: str  # "gl", "dx" or ""
    prefix: str
    variant: tuple[str, ...]


def _recognized(path: Path) -> _File | None:
    """Return what an image's name tells, None if it names no map."""
    stem = re.sub(r"(?i)(open|direct)[ _-]?(?=gl|x)", lambda found: "_" if found[1].lower() == "open" else "_D", path.stem)
    words = [w for w in re.split(r"[^A-Za-z0-9]+|(?<=[a-z])(?=[A-Z])", stem) if w]
    words = [w.lower() for w in words]
    variant: list[str] = []
    convention = ""
    while words:
        word = words[-1]
        if word in _GL or word in _DX:
            convention = "gl" if word in _GL else "dx"
        elif _VARIANT.fullmatch(word):
            variant.append(word)
        else:
            break
        words.pop()
    if not words:
        return None
    # Names run together: normalgl, NormalDX.
    ending = re.fullmatch(r"(normal|nor|nrm)(gl|dx)", words[-1])
    if ending:
        words[-1], convention = ending[1], ending[2]
    for count in (2, 1):
        kind = _KINDS.get("".join(words[-count:])) if len(words) >= count else None
        if kind is not None:
            before = [w for w in words[:-count] if not _VARIANT.fullmatch(w)]
            variant += [w for w in words[:-count] if _VARIANT.fullmatch(w)]
            return _File(path, kind, convention if kind == "normal" else "", "_".join(before), tuple(sorted(variant)))
    return None


def _chosen(folder: Path) -> tuple[list[_File], list[str]]:
    """Return the files of one material in a folder, one for each meaning, and notes of what is left out."""
    try:
        images = sorted(p for p in folder.iterdir() if p.suffix.lower() in READABLE_SUFFIXES and not p.name.startswith("."))
    except OSError as error:
        raise FileError(f"{folder}: can't be read ({error.strerror or error})") from error
    found = [(path, _recognized(path)) for path in images]
    unknown = [path.name for path, file in found if file is None]
    groups: dict[tuple[str, str], list[_File]] = {}
    for _, file in found:
        if file is not None:
            groups.setdefault((file.prefix, _resolution(file)), []).append(file)
    if not groups:
        return [], []
    # The most maps; of as many, the finest; then by name.
    best = max(sorted(groups), key=lambda g: (len({f.kind for f in groups[g]}), int(g[1].rstrip("k") or 0)))
    notes = []
    others = [f.path.name for group, files in groups.items() if group != best for f in files]
    if others:
        notes.append(f"left out as another size or material: {_listed(others)}")
    if unknown:
        notes.append(f"left out, since their names tell no map: {_listed(unknown)}")
    chosen: dict[str, _File] = {}
    for file in sorted(groups[best], key=_preference):
        if file.kind not in chosen:
            chosen[file.kind] = file
        else:
            notes.append(f"left out: {file.path.name}, since {chosen[file.kind].path.name} is the {file.kind} map too")
    order = list(_WORDS)
    return sorted(chosen.values(), key=lambda f: order.index(f.kind)), notes


def _listed(names: list[str]) -> str:
    return ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")


def _resolution(file: _File) -> str:
    return next((w for w in file.variant if re.fullmatch(r"\d+k", w)), "")


def _preference(file: _File) -> tuple[int, int, str]:
    """Sort files of one meaning: normals for OpenGL first, lossless ones before JPEG."""
    return file.convention == "dx", file.path.suffix.lower() in (".jpg", ".jpeg"), file.path.name


def holds_material(folder: PathLike) -> bool:
    """Whether a folder holds maps of a material by their names: at least two, or one of colours; and no light positions."""
    folder = Path(folder)
    try:
        if any(_LIGHTS.fullmatch(p.name.lower()) for p in folder.iterdir()):
            return False
    except OSError:
        return False
    files, _ = _chosen(folder)
    return len(files) > 1 or any(f.kind == "color" for f in files)


@checked_arguments
def read_material(folder: PathLike) -> Material:
    """Read the maps of a material from a folder, each by the meaning of its name.

    Names of ambientCG (``Bricks001_2K_NormalGL.png``), Poly Haven (``brick_wall_nor_gl_2k.png``), Substance
    (``Brick_BaseColor.png``) and alike are known. Colours are decoded from sRGB; all other maps are taken as they are stored.
    Normals of the DirectX convention are turned to OpenGL's, and those that are not of unit length are made so.

    Parameters
    ----------
    folder : path
        Of several resolutions or materials in it, the one with the most maps, then the finest, is read.

    Returns
    -------
    Material
        The maps, with notes of what was chosen, left out and mended.

    Raises
    ------
    FileError
        If there is no such folder, no file in it is named like a map, or a map can't be read.
    InputError
        If the maps differ in size, have values that are not finite, or numbers of channels that they can't have.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import intaglio
    >>> ramp = np.tile(np.linspace(0, 1, 30, dtype=np.float32), (30, 1))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     intaglio.write_image(np.dstack([ramp] * 3), f"{folder}/Wood_1K_Color.png")
    ...     intaglio.write_image(ramp, f"{folder}/Wood_1K_Displacement.png", bits=16)
    ...     material = intaglio.read_material(folder)
    >>> {kind: values.shape for kind, values in material.maps.items()}
    {'color': (30, 30, 3), 'displacement': (30, 30)}
    """
    folder = Path(folder)
    try:
        is_folder, exists = folder.is_dir(), folder.exists()
    except OSError as error:
        raise FileError(f"{folder}: is no usable folder name ({error.strerror})") from error
    if not is_folder:
        raise FileError(f"{folder}: {'is a file, a folder of maps is needed' if exists else 'no such folder'}")
    files, notes = _chosen(folder)
    if not files:
        raise FileError(f"{folder}: no image in it is named like a map of a material, such as wood_color.png or wood_normal.png")
    maps: dict[str, Array] = {}
    names: dict[str, str] = {}
    bits: dict[str, int] = {}
    opaque = None
    for file in files:
        values, bits[file.kind] = _read_map(file)
        if values.ndim == 3 and values.shape[2] == 4:
            if file.kind == "color" and (values[:, :, 3] <= 0.5).any():
                opaque = values[:, :, 3] > 0.5
            values = np.ascontiguousarray(values[:, :, :3])
        names[file.kind] = file.path.name
        if file.kind == "normal":
            values, said = _mended_normals(values, file)
            notes += said
            if file.convention == "dx":
                names["normal"] = _for_opengl(file.path.name)
        maps[file.kind] = values
    _check_sizes(folder, files, maps)
    if opaque is not None and not opaque.any():
        raise InputError(f"{folder}: its colour map is all transparent, there is nothing to copy")
    return Material(maps, names, bits, opaque, tuple(notes))


def _read_map(file: _File) -> tuple[Array, int]:
    """Return a map's linear values and its bits."""
    values, kind = read_image_with_type(file.path, linear=None if file.kind in _COLORS else True)
    if kind == np.uint16 and file.kind in _COLORS:
        # Colours are encoded, whether or not the file says so.
        values, _ = read_image_with_type(file.path, linear=False)
    if kind.kind in "iu" and kind not in (np.uint8, np.uint16):
        raise InputError(f"{file.path}: holds {kind} values; a map has 8 or 16 bits, or floats")
    if not np.isfinite(values).all():
        raise InputError(f"{file.path}: has {int((~np.isfinite(values)).sum())} values that are not finite; a map has none")
    if file.kind in ("normal", "arm") and values.ndim != 3:
        raise InputError(f"{file.path}: is named like a map of three channels ({file.kind}), but is grey")
    return values, kind.itemsize * 8 if kind.kind == "u" else 32


def _mended_normals(values: Array, file: _File) -> tuple[Array, list[str]]:
    """Return normals of unit length whose green points upwards, and what was done."""
    notes: list[str] = []
    if file.convention == "dx":
        values = values.copy()
        values[:, :, 1] = 1 - values[:, :, 1]
        notes.append(f"{file.path.name}: its normals are of the DirectX convention; their green was turned to OpenGL's")
    normal = values.astype(np.float64) * 2 - 1
    if (values[:, :, 2] < _OFF_UNIT).all():
        # Two channels are stored, the third follows.
        normal[:, :, 2] = np.sqrt(np.maximum(1 - normal[:, :, 0] ** 2 - normal[:, :, 1] ** 2, 0))
        values = ((normal + 1) / 2).astype(np.float32)
        notes.append(f"{file.path.name}: its blue is empty; it was made from red and green")
    length = np.linalg.norm(normal, axis=2)
    off = np.abs(length - 1) > _OFF_UNIT
    if off.any():
        normal[length < 1e-6] = (0, 0, 1)
        length = np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-6)
        values = np.where(off[:, :, None], ((normal / length + 1) / 2).astype(np.float32), values)
        notes.append(f"{file.path.name}: {off.mean():.1%} of its normals were made of unit length")
    return np.ascontiguousarray(values), notes


def _for_opengl(name: str) -> str:
    """Return a file's name with OpenGL's mark in place of DirectX's."""
    stem, suffix = Path(name).stem, Path(name).suffix
    for dx, gl in (("DirectX", "OpenGL"), ("directx", "opengl"), ("DX", "GL"), ("dx", "gl"), ("Dx", "Gl")):
        if dx in stem:
            at = stem.rindex(dx)
            return f"{stem[:at]}{gl}{stem[at + len(dx) :]}{suffix}"
    return name


def _check_sizes(folder: Path, files: list[_File], maps: Mapping[str, Array]) -> None:
    sizes = {f"{m.shape[1]} x {m.shape[0]}" for m in maps.values()}
    if len(sizes) > 1:
        listed = ", ".join(f"{f.path.name} {maps[f.kind].shape[1]} x {maps[f.kind].shape[0]}" for f in files)
        raise InputError(
            f"{folder}: its maps differ in size ({listed}); scale them to one size, or move those of others elsewhere"
        )
