"""Surface: a triangulated surface as smooth base plus relief, with colour and provenance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.checks import check_fields, checked_arguments, checked_faces, checked_rows, checked_shape
from intaglio.errors import InputError
from intaglio.kernels.connectivity import area_vectors
from intaglio.mesh.topology import LARGE
from intaglio.mesh.writing import write_surface

if TYPE_CHECKING:
    from collections.abc import Callable

    from intaglio.mesh.base import Base

# Arrays with a row per vertex that are carried along as they are when vertices are chosen.
_PROVENANCE = ("rotation", "mirrored", "exemplar", "exemplar_source", "error", "confidence")
PER_VERTEX = ("vertices", "base", "normal", "color", "measured", *_PROVENANCE)
# The same with a row per face, where faces are chosen.
PER_FACE = ("uv", "measured_face", "face_picture")
# So many rows are gone through at once, where a table of them all would be many times as large as the mesh.
_AT_ONCE = 1 << 16


@dataclass(frozen=True, kw_only=True)
class Surface:
    """Triangulated surface as smooth base plus relief, with colour and provenance.

    The vertices are stored and the relief is derived from them, so that measured vertices keep their bits.

    Parameters
    ----------
    vertices : (N, 3) array
        Positions in the input's own unit, kept as float64.
    faces : (F, 3) int array
        Triangles, counter-clockwise seen from outside.
    base : (N, 3) array, optional
        Point of the smooth base below every vertex. Default the vertex itself: a scan just read has no base yet.
    normal : (N, 3) array, optional
        Unit normal of the base there. Default the area-weighted normals of the faces.
    color : (N, 3) array or None, optional
        Linear Rec.709 colours in [0, 1], kept as float32. Default None: no colours.
    measured : (N,) bool array, optional
        True where the vertex was measured, False where it was filled. Default all True.
    source : (N,) int32 array, optional
        The measured vertex whose relief vertex i carries: itself where measured, -1 where not yet filled. Default so.
    rotation : (N,) float32 array or None, optional
        Angle in radians by which the source's neighbourhood was turned about the normal to match; 0 where measured.
        Default None: nothing was matched.
    mirrored : (N,) bool array or None, optional
        Whether the source's neighbourhood was mirrored before it was turned: along the second axis of the local frame. Default
        None: none was.
    exemplar, exemplar_source : (N,) int32 arrays or None, optional
        Where relief came from other scans: which of them, from 1, and the vertex there; ``source`` is -1 then. 0 and -1 for
        relief of the scan's own. Default None: all is.
    error : (N,) float32 array or None, optional
        Error of the accepted match: weighted mean squared distance, in the square of the input's unit; 0 where measured,
        infinite where no sample could be compared and a neighbour's relief was taken. Default None: nothing was matched.
    confidence : (N,) float32 array or None, optional
        How sure a filled vertex is, from 0 to 1; 1 where measured. Default None: nobody has judged it.
    measured_face : (F,) bool array or None, optional
        True where a face is the scan's own. A face that was filled may have three measured corners, on the rim of what was
        missing: the vertices' ``measured`` doesn't tell it. Default None: nothing was filled.
    model : Base or None, optional
        The base shape. Default None: there is none yet.
    uv : (F, 3, 2) float64 array or None, optional
        Texture coordinates of every corner of the faces, v upwards; NaN where a face has none. Default None.
    picture : bytes or None, optional
        Content of the image file (PNG, JPEG) that ``uv`` refers to. Default None.
    more_pictures : tuple of bytes, optional
        Further image files, where ``uv`` refers to several: those of a scan with several textures, and last the one of what was
        filled. Default none.
    face_picture : (F,) int32 array or None, optional
        Which image file a face's ``uv`` refers to: 0 is ``picture``, 1 the first of ``more_pictures``, -1 none. Default None:
        ``picture`` for all.
    file_vertex : (N,) int32 array or None, optional
        The vertex, from 0, of the file that the surface was read from; -1 for one that was filled. Default None: the same
        number.
    notes : tuple of str, optional
        What was chosen on the way, as sentences for the user. Default none.

    Raises
    ------
    InputError
        For arrays of the wrong shape or type, coordinates that are not finite, or face indices or sources out of range.

    See Also
    --------
    intaglio.read_surface : Read a surface from a file.
    intaglio.complete_relief : Fill a surface's holes with relief.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> square = intaglio.Surface(vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]))
    >>> square.normal
    array([[0., 0., 1.],
           [0., 0., 1.],
           [0., 0., 1.],
           [0., 0., 1.]])
    >>> square.measured
    array([ True,  True,  True,  True])

    With a base, the surface has relief:

    >>> raised = intaglio.Surface(vertices=corners + [0, 0, 0.5], faces=square.faces, base=corners)
    >>> raised.relief
    array([0.5, 0.5, 0.5, 0.5])
    """

    vertices: Array
    faces: Array
    base: Array = None  # type: ignore[assignment]
    normal: Array = None  # type: ignore[assignment]
    color: Array | None = None
    measured: Array = None  # type: ignore[assignment]
    source: Array = None  # type: ignore[assignment]
    rotation: Array | None = None
    mirrored: Array | None = None
    exemplar: Array | None = None
    exemplar_source: Array | None = None
    error: Array | None = None
    confidence: Array | None = None
    measured_face: Array | None = None
    model: Base | None = None
    uv: Array | None = None
    picture: bytes | None = None
    more_pictures: tuple[bytes, ...] = ()
    face_picture: Array | None = None
    file_vertex: Array | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        def put(name: str, value: Array) -> None:
            object.__setattr__(self, name, value)

        check_fields(self, nan=True)
        vertices = checked_rows("vertices", self.vertices, np.float64)
        count = len(vertices)
        put("vertices", vertices)
        put("faces", checked_faces("faces", self.faces, count))
        put("base", vertices if self.base is None else checked_rows("base", self.base, np.float64, count))
        if self.normal is None:
            put("normal", vertex_normals(vertices, self.faces))
        else:
            put("normal", checked_rows("normal", self.normal, np.float64, count))
        if self.color is not None:
            put("color", checked_rows("color", self.color, np.float32, count))
        measured = np.ones(count, bool) if self.measured is None else self.measured
        if measured.dtype.kind not in "bui":
            raise InputError(f"measured must be bool, not {measured.dtype}")
        if measured.shape != (count,):
            raise InputError(f"measured must have shape ({count},), not {measured.shape}")
        put("measured", measured.astype(bool))
        if self.mirrored is not None:
            if self.mirrored.dtype.kind not in "bui":
                raise InputError(f"mirrored must be bool, not {self.mirrored.dtype}")
            put("mirrored", checked_shape("mirrored", self.mirrored, bool, (count,)))
        if self.source is None:
            put("source", np.where(self.measured, np.arange(count), -1).astype(np.int32))
        numbers = dict.fromkeys(("source", "file_vertex", "exemplar", "exemplar_source"), np.int32)
        for name, dtype in {**numbers, "rotation": np.float32, "error": np.float32, "confidence": np.float32}.items():
            value = getattr(self, name)
            if value is None:
                continue
            put(name, checked_shape(name, value, dtype, (count,)))
        if self.confidence is not None and not ((self.confidence >= 0) & (self.confidence <= 1)).all():
            raise InputError("confidence must be from 0 to 1 at every vertex")
        if self.uv is not None:
            uv = np.ascontiguousarray(self.uv, np.float64)
            if uv.shape != (len(self.faces), 3, 2):
                raise InputError(f"uv must have shape ({len(self.faces)}, 3, 2), two numbers for every corner, not {uv.shape}")
            put("uv", uv)
        self._put_faces(put)
        if count and not (self.source.min() >= -1 and self.source.max() < count):
            raise InputError(f"source must hold vertex numbers from 0 to {count - 1}, or -1; it holds {self.source.max()}")

    def _put_faces(self, put: Callable[[str, Array], None]) -> None:
        """Check what is held for every face."""
        faces = (len(self.faces),)
        if self.measured_face is not None:
            if self.measured_face.dtype.kind not in "bui":
                raise InputError(f"measured_face must be bool, not {self.measured_face.dtype}")
            if self.measured_face.shape != faces:
                raise InputError(f"measured_face must have shape {faces}, not {self.measured_face.shape}")
            put("measured_face", self.measured_face.astype(bool))
        if self.more_pictures and (self.picture is None or self.face_picture is None):
            raise InputError("more_pictures go with a picture and with face_picture, which says whose they are")
        if self.face_picture is not None:
            shown = checked_shape("face_picture", self.face_picture, np.int32, faces)
            known = len(self.pictures)
            if len(shown) and not (shown.min() >= -1 and shown.max() < known):
                raise InputError(f"face_picture must hold numbers of the {known} pictures, from 0, or -1; it holds {shown.max()}")
            put("face_picture", shown)

    @property
    def pictures(self) -> tuple[bytes, ...]:
        """All image files that texture coordinates refer to: ``picture`` and ``more_pictures``.

        Returns
        -------
        tuple of bytes
            What the files hold; a face's is the one that ``face_picture`` numbers.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> triangle = intaglio.Surface(vertices=np.eye(3), faces=np.array([[0, 1, 2]]))
        >>> triangle.pictures
        ()
        """
        return (() if self.picture is None else (self.picture,)) + self.more_pictures

    @property
    def displacement(self) -> Array:
        """Vectors from the base to the vertices.

        Returns
        -------
        (N, 3) float64 array
            Vertices minus base, in the input's unit of length.

        References
        ----------
        Breckon & Fisher, "Three-Dimensional Surface Relief Completion via Nonparametric Techniques", IEEE TPAMI 30(12),
        2008, section 2: the displacement vector D.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
        >>> raised = intaglio.Surface(vertices=corners + [0, 0, 0.5], faces=np.array([[0, 1, 2]]), base=corners)
        >>> raised.displacement[0]
        array([0. , 0. , 0.5])
        """
        return self.vertices - self.base

    @property
    def relief(self) -> Array:
        """Signed displacements along the base's normals.

        Returns
        -------
        (N,) float64 array
            Displacements in the input's unit of length, positive on the side that the normal points to.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
        >>> lowered = intaglio.Surface(vertices=corners - [0, 0, 0.5], faces=np.array([[0, 1, 2]]), base=corners)
        >>> lowered.relief
        array([-0.5, -0.5, -0.5])
        """
        return np.einsum("ij,ij->i", self.displacement, self.normal)

    @checked_arguments
    def write(self, path: PathLike, *, overwrite: bool = True) -> None:
        """Write the surface to a file; PLY keeps its base and provenance.

        Parameters
        ----------
        path : path
            The file; its suffix decides the type: .ply, .obj, .stl, .off, .gltf, .glb.
        overwrite : bool, optional
            Replace a file of that name. Default True.

        Raises
        ------
        FileError
            If the suffix is unknown, the file exists and may not be replaced, or can't be written.
        InputError
            If coordinates are too large for the type's single precision, or the type needs faces and there are none.

        See Also
        --------
        intaglio.write_surface : The same as a function, with what each type keeps.

        Examples
        --------
        >>> import tempfile
        >>> import numpy as np
        >>> import intaglio
        >>> surface = intaglio.Surface(vertices=np.eye(3), faces=np.array([[0, 1, 2]]))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     surface.write(f"{folder}/triangle.ply")
        ...     back = intaglio.read_surface(f"{folder}/triangle.ply")
        >>> np.array_equal(back.vertices, surface.vertices)
        True
        """
        write_surface(self, path, overwrite=overwrite)

    @checked_arguments
    def part(self, keep: Array) -> Surface:
        """Return the part of the surface that consists of selected vertices.

        Faces stay if all of their corners do. Vertices are renumbered; a source outside the part becomes -1.

        Parameters
        ----------
        keep : (N,) bool array
            Which vertices to keep.

        Returns
        -------
        Surface
            The part, with the same model and notes.

        Raises
        ------
        InputError
            If ``keep`` is not a bool array with one value per vertex.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
        >>> square = intaglio.Surface(vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]))
        >>> half = square.part(np.array([True, False, True, True]))
        >>> half.faces
        array([[0, 1, 2]], dtype=int32)
        """
        if keep.shape != (len(self.vertices),) or keep.dtype != bool:
            raise InputError(f"keep must be a bool array of shape ({len(self.vertices)},), not {keep.dtype} {keep.shape}")
        renumber = np.where(keep, np.cumsum(keep) - 1, -1).astype(np.int32)
        whole = keep[self.faces].all(axis=1)
        source = self.source[keep]
        fields = {name: value[keep] for name in PER_VERTEX if (value := getattr(self, name)) is not None}
        fields |= {name: value[whole] for name in PER_FACE if (value := getattr(self, name)) is not None}
        return replace(
            self,
            **fields,
            faces=renumber[self.faces[whole]],
            source=np.where(source >= 0, renumber[source], -1),
            file_vertex=(np.arange(len(keep)) if self.file_vertex is None else self.file_vertex)[keep],
        )


def vertex_normals(vertices: Array, faces: Array) -> Array:
    """Return area-weighted unit normals (N, 3) at the vertices; (0, 0, 1) where no face with an area meets."""
    faces, vertices = np.asarray(faces), np.asarray(vertices)
    if len(faces) > LARGE:
        normal = area_vectors(vertices, faces)
    else:
        normal = np.zeros((len(vertices), 3))
        corners = vertices[faces]
        area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        for axis in range(3):
            normal[:, axis] = np.bincount(faces.reshape(-1), np.repeat(area[:, axis], 3), len(vertices))
    for at in range(0, len(vertices), _AT_ONCE):
        some = normal[at : at + _AT_ONCE]
        length = np.linalg.norm(some, axis=1, keepdims=True)
        some[:] = np.where(length > 0, some / np.maximum(length, 1e-300), (0.0, 0.0, 1.0))
    return normal
