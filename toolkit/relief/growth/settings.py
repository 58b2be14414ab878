"""What a user decides about the growth of relief: checked once, then passed on unchanged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, Field, dataclass, field, fields

import numpy as np

from intaglio.checks import check_fields, checked_choice, checked_count, checked_number, checked_positive, shown
from intaglio.errors import InputError

RULES = ("near-best", "best-percent")
METRICS = ("displacement", "surface")
ORDERS = ("wave", "sequential")
SEARCHES = ("auto", "exhaustive", "approximate")
ENGINES = ("auto", "blas", "warp")
METHODS = ("pieces", "propagation")
PARTNERS = ("measured", "textured")

_MOST_WINDOW, _MOST_ROTATIONS, _MOST_LEVELS, _MOST_PASSES, _MOST_HALVINGS = 64, 720, 6, 100, 4
_PASSES, _MOST_TURNS = 3, 1000
# Options that both methods have.
_SHARED = ("rotations", "method", "mirror", "symmetry")
# Options of pieces alone.
_OF_PIECES = ("mirror", "symmetry")
SYMMETRIES = ("auto", "none")


@dataclass(frozen=True)
class Selection:
    """How a match is chosen among the candidates.

    Parameters
    ----------
    rule : {"near-best", "best-percent"}
        "near-best": at random among the candidates whose error is at most ``1 + tolerance`` times the least (Breckon &
        Fisher, 3DIM 2005, appendix A). "best-percent": at random among the best ``eta`` percent (TPAMI 2008, section 2.2.2).
    tolerance : float
        At least 0.
    eta : float
        Percentage in (0, 100].

    Raises
    ------
    InputError
        For an unknown rule or a number out of range.

    References
    ----------
    T. P. Breckon, R. B. Fisher, "Non-parametric 3D Surface Completion", 3DIM 2005, appendix A; "Three-Dimensional Surface
    Relief Completion via Nonparametric Techniques", IEEE TPAMI 30(12), 2008, section 2.2.2.

    Examples
    --------
    >>> import intaglio
    >>> intaglio.Selection("best-percent", eta=5)
    Selection(rule='best-percent', tolerance=0.1, eta=5.0)
    """

    rule: str = "near-best"
    tolerance: float = 0.1
    eta: float = 10.0

    def __post_init__(self) -> None:
        check_fields(self)
        checked_choice("selection rule", self.rule, RULES)
        object.__setattr__(self, "tolerance", checked_number("tolerance", self.tolerance, 0))
        eta = checked_number("eta", self.eta, 0, 100)
        if eta == 0:
            raise InputError(f"eta must be a percentage above 0 and up to 100, not {shown(self.eta)}")
        object.__setattr__(self, "eta", eta)


@dataclass(frozen=True)
class ReliefSettings:
    """How relief is grown over a prepared scan; None leaves a choice to the relief itself, and the notes say why it fell so.

    Parameters
    ----------
    window : int, optional
        Radius w of the neighbourhoods in edges (times the spacing in length), 1 to 64. It should cover the largest feature
        that repeats. Default from the relief's period or correlation length.
    rotations : int, optional
        Every sample is tried at R rotations about its normal, up to 720. 0 or 1 for none, as suits relief with a direction;
        12 or more for isotropic relief. Default 1 where the relief has a direction, else 12.
    error : float, optional
        A match is accepted below this bound e on its weighted mean squared distance, in squared input units. The bound rises by
        10 % whenever no target can be filled. With several levels the difference in coarse relief counts in a match's distance
        as well. Default from the noise, between a tenth and a half of the variance of what is compared.
    levels : int
        Scales, 1 to 6: relief is completed coarse to fine. Each level's targets lie half as far apart as those of the one
        before it, and are compared in the coarser relief as well.
    refine : int, optional
        Passes, 0 to 100, that match the filled part again as a whole, vote, copy, and draw the heights towards the measured
        distribution. Default 0 for holes alone, against whose truth they do more harm than good, else 3; 0 with
        ``interpolate``, and with the metric "surface", ``bootstrap`` and textured ``partners``, which allow none.
    color_weight : float, optional
        1 - mu of 3DIM 2005, section 6, in [0, 1]: how much colour counts beside shape, both normalised to [0, 1]. Costs are
        then the combined measure times the squared largest difference of measured displacements. Default: shape alone
        decides. Colours are carried along with the relief in any case.
    metric : {"displacement", "surface"}
        "displacement" compares heights over a tangent grid; "surface" is the papers' point-to-triangle measure, slower.
    order : {"wave", "sequential"}
        "wave" fills the whole boundary list at once; "sequential" one vertex after the other, as the papers do.
    selection : Selection
        How a match is chosen among the candidates.
    search : {"auto", "exhaustive", "approximate"}
        "exhaustive" compares every sample; "approximate" looks beside what neighbours were matched to, and beside the best of
        some thousand samples. "auto": exhaustive up to 50,000 candidates (samples times rotations), and beyond while it is
        a matter of seconds.
    bootstrap : bool
        Filled vertices become samples.
    oversample : bool or int, optional
        Halve the sample set's edges, so many times (True: once), up to 4. Default once where targets don't continue the scan's
        lattice and candidates stay few. With the metric "surface" the scan's triangles are subdivided with them, and the window's
        edges are halved there.
    subsample : float
        Share of the samples that is compared, chosen by the seed; above 0 and up to 1, all. The surface they lie on stays whole.
    partners : {"measured", "textured"}
        What a target's neighbours may fall on where they are laid around a sample: "measured" vertices only (3DIM 2005,
        appendix A), or all that are textured by then, filled ones too (section 3 there; TPAMI 2008, section 2.2.2), so that
        samples beside the missing part serve as well.
    interpolate : bool
        Take the displacement between the sample's vertices, at the place where the neighbourhood fits best: for targets that are
        out of phase with the scan's lattice. ``source`` is the measured vertex that is nearest to it.
    along_relief : bool
        Turn every local frame along the slope of the coarser relief (``levels`` of 2 and more), so that one rotation does for
        relief without a direction.
    engine : {"auto", "blas", "warp"}
        How the displacement metric's costs are computed; with the rule "near-best" the choices are the same.
    method : {"pieces", "propagation"}, optional
        "pieces": coherent pieces of the scan, found at all scales at once and joined by their differences. "propagation": Breckon
        & Fisher's, vertex by vertex from the rim. Default: "propagation" where one of its own options is given, which are all but
        ``rotations``, ``mirror`` and ``symmetry``; else "pieces" over a smooth base, and "propagation" over a plane, cylinder or
        sphere, whose unseen parts may be larger than what was seen.
    mirror : bool
        Pieces may be mirror images as well.
    symmetry : {"auto", "none"} or sequence of float
        Whether a hole is filled, as a whole, from a place of the scan that is like it. "auto": where one is found that is alike
        all around the hole, turned, moved or mirrored. (nx, ny, nz, d): by the mirror plane n . x = d. (px, py, pz, dx, dy, dz,
        count): by the axis through p along d, turned by whole parts of a circle. Given ones are refined by registration.

    Raises
    ------
    InputError
        For a value out of range, or two settings that exclude each other.

    References
    ----------
    Breckon & Fisher, IEEE TPAMI 30(12), 2008, section 2.2; 3DIM 2005, section 6 and appendix A.

    Examples
    --------
    >>> import intaglio
    >>> intaglio.ReliefSettings(mirror=True).method
    'pieces'
    >>> settings = intaglio.ReliefSettings(window=7, refine=3)
    >>> settings.method, settings.window, settings.levels, settings.selection.rule
    ('propagation', 7, 1, 'near-best')
    """

    window: int | None = None
    rotations: int | None = None
    error: float | None = None
    levels: int = 1
    refine: int | None = None
    color_weight: float | None = None
    metric: str = "displacement"
    order: str = "wave"
    selection: Selection = field(default_factory=Selection)
    search: str = "auto"
    bootstrap: bool = False
    oversample: bool | int | None = None
    subsample: float = 1.0
    partners: str = "measured"
    interpolate: bool = False
    along_relief: bool = False
    engine: str = "auto"
    method: str | None = None
    mirror: bool = False
    symmetry: str | Sequence[float] = "auto"

    def __post_init__(self) -> None:
        check_fields(self)
        self._choose_method()

        def put(name: str, value: object) -> None:
            object.__setattr__(self, name, value)

        if self.window is not None:
            put("window", checked_count("window", self.window, 1, _MOST_WINDOW))
        if self.rotations is not None:
            put("rotations", checked_count("rotations", self.rotations, 0, _MOST_ROTATIONS) or 1)
        if self.error is not None:
            put("error", checked_positive("error", self.error))
        put("levels", checked_count("levels", self.levels, 1, _MOST_LEVELS))
        if self.refine is not None:
            put("refine", checked_count("refine", self.refine, 0, _MOST_PASSES))
        put("symmetry", _checked_symmetry(self.symmetry))
        if self.color_weight is not None:
            put("color_weight", _color_share(self.color_weight))
        if self.oversample is not None:
            put("oversample", checked_count("oversample", int(self.oversample), 0, _MOST_HALVINGS))
        if not 0 < self.subsample <= 1:
            raise InputError(f"subsample must be a share above 0 and up to 1, not {shown(self.subsample)}")
        known = {"metric": METRICS, "order": ORDERS, "search": SEARCHES, "engine": ENGINES, "partners": PARTNERS}
        for name, choices in known.items():
            checked_choice(name, getattr(self, name), choices)
        self._check_together()

    @property
    def compares_all(self) -> bool:
        """Whether every sample must be compared: ranks, growing sample sets and growing surroundings need it.

        Examples
        --------
        >>> import intaglio
        >>> intaglio.ReliefSettings(bootstrap=True).compares_all
        True
        """
        return self.bootstrap or self.partners == "textured" or self.selection.rule == "best-percent"

    def _choose_method(self) -> None:
        """Decide the method by the options that were given, and raise `InputError` for one that the other method has."""
        given = [f.name for f in fields(self) if f.name not in _SHARED and getattr(self, f.name) != _default(f)]
        method = self.method
        own = [name for name in _OF_PIECES if getattr(self, name) != _default(next(f for f in fields(self) if f.name == name))]
        if method is None and (given or own):
            method = "propagation" if given else "pieces"
        if method is not None:
            checked_choice("method", method, METHODS)
        if method == "pieces" and given:
            raise InputError(f"{given[0]} goes with method='propagation'; leave it out or change the method")
        if method == "propagation" and own:
            raise InputError(f"{own[0]} goes with method='pieces'; leave it out or change the method")
        object.__setattr__(self, "method", method)

    def _check_together(self) -> None:
        """Raise `InputError` where two settings exclude each other."""
        if self.metric == "surface":
            for name, asked in (
                ("refine", bool(self.refine)),
                ("levels", self.levels > 1),
                ("search='approximate'", self.search == "approximate"),
            ):
                if asked:
                    raise InputError(f"{name} works with metric='displacement'; leave it out or change the metric")
        if self.refine and self.bootstrap:
            raise InputError("refine copies from measured samples; set bootstrap=False or refine=0")
        if self.refine and self.partners == "textured":
            raise InputError("refine compares with measured surroundings; set partners='measured' or refine=0")
        if self.search == "approximate" and self.compares_all:
            other = "bootstrap" if self.bootstrap else "selection='best-percent'"
            if self.partners == "textured":
                other = "partners='textured'"
            raise InputError(f"{other} compares every sample: leave search at 'auto' or 'exhaustive'")
        if self.along_relief and self.levels == 1:
            raise InputError("along_relief turns frames by the coarser relief: give levels=2 or more")


def refinement_passes(settings: ReliefSettings, holes_alone: bool) -> int:
    """Return the refinement passes to make: as given, or none where holes alone are missing and where none are allowed."""
    if settings.refine is not None:
        return settings.refine
    alone = settings.metric == "surface" or settings.bootstrap or settings.partners == "textured" or settings.interpolate
    return 0 if alone or holes_alone else _PASSES


def _default(field: Field[object]) -> object:
    return field.default if field.default_factory is MISSING else field.default_factory()


def _checked_symmetry(value: str | Sequence[float]) -> str | tuple[float, ...]:
    meaning = (
        "symmetry must be 'auto', 'none', a mirror plane (nx, ny, nz, d), or an axis and how many turns make a circle "
        "(px, py, pz, dx, dy, dz, count)"
    )
    if isinstance(value, str):
        if value not in SYMMETRIES:
            raise InputError(f"{meaning}, not {value!r}")
        return value
    try:
        given = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        given = np.zeros(0)
    if given.shape not in ((4,), (7,)) or not np.isfinite(given).all():
        raise InputError(f"{meaning}, not {shown(value)}")
    way = given[:3] if len(given) == 4 else given[3:6]
    if not np.linalg.norm(way) > 0:
        raise InputError(f"{meaning}; the direction {tuple(way.tolist())} has no length")
    if len(given) == 7 and not (given[6] == int(given[6]) and 2 <= given[6] <= _MOST_TURNS):
        raise InputError(f"{meaning}; count must be a whole number from 2 to {_MOST_TURNS}, not {given[6]:g}")
    return tuple(given.tolist())


def _color_share(value: float) -> float:
    if not 0 <= value <= 1:
        raise InputError(f"color_weight must be a number from 0 (shape alone) to 1 (colour alone), not {shown(value)}")
    return float(value)
