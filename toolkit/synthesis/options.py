"""How a texture is synthesised: the options of the three methods, each validated when it is made."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.checks import check_fields, checked_choice, checked_count, checked_number, shown
from intaglio.errors import InputError

CUTS = ("path", "graph", "none")
CONTINUATIONS = ("shortcut", "search", "avoid")

# With a larger tolerance every block is a candidate anyway.
_MOST_TOLERANCE = 1e6


@dataclass(frozen=True)
class WeaveOptions:
    """Options of synthesis by coherent pieces, for `synthesize` and `synthesize_each_light`.

    `weave` takes the same options as arguments.

    Parameters
    ----------
    block : int or "auto", optional
        Side in pixels of the blocks that synthesis begins with, at least 2 and no larger than the sample; rounded to pixels of
        the coarse level. "auto": several are tried, and the one whose result is most like the sample is taken.
    passes : int, optional
        How often the patches over borders are matched and vote on each level, 0 to 100. 0: the blocks as they were laid.
    exact : bool, optional
        Only copies: pieces are not joined, and all maps hold the sample's bits.

    Raises
    ------
    InputError
        If a value is out of range.

    See Also
    --------
    intaglio.weave : The method, with its references.
    intaglio.QuiltOptions, intaglio.GrowOptions : The options of the other methods.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> sample = np.tile(np.eye(8), (8, 8))
    >>> made = intaglio.synthesize(sample, (80, 96), intaglio.WeaveOptions(block=24, exact=True), device="cpu")
    >>> made.moved is None
    True
    """

    block: int | str = "auto"
    passes: int = 2
    exact: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "passes", checked_count("passes", self.passes, 0, 100))
        _check_block(self.block)
        check_fields(self)


@dataclass(frozen=True)
class QuiltOptions:
    """Options of synthesis by blocks, for `synthesize` and `synthesize_each_light`.

    `quilt` takes the same options as arguments; there ``refine`` is 0 by default.

    Parameters
    ----------
    block : int or "auto", optional
        Side of a block in pixels, at least 2 and no larger than the sample. "auto": the side that holds one element of the
        texture, by the sample's autocorrelation, or another whose small result is nearer to the sample, by trial.
    overlap : int, optional
        How far neighbouring blocks overlap, in pixels, from 1 to ``block`` - 1. Default None: a third of the block (Dong,
        section 5.4.3, recommends 1/6 to 1/3).
    tolerance : float, optional
        A block is drawn from those whose difference is at most (1 + tolerance) times the least, 0 to 1e6.
    cut : {"path", "graph", "none"}, optional
        The boundary between blocks: a path through the overlap on each side by dynamic programming, a minimum cut of any
        shape through all of the overlap (slower), or none.
    continuation : {"shortcut", "search", "avoid"}, optional
        What happens if the sample itself continues the blocks already laid. "shortcut" takes the sample's next block without
        a search if all neighbours agree on it (Dong, section 5.3.2). "search" compares it with all other blocks, whose
        overlaps are seldom as good. "avoid" excludes it, and every block that begins within half a block of it (fewer in
        samples that have few blocks), so that copied pieces are hardly larger than blocks.
    refine : int, optional
        Passes of texture optimisation for each size of window (32, 16 and 8 pixels, as far as ``block`` allows), 0 to 100.
        It removes visible seams and runs on the CPU. 0: none.

    Raises
    ------
    InputError
        If a value is out of range.

    See Also
    --------
    intaglio.quilt : The method, with its references.
    intaglio.GrowOptions : The options of the other method.

    References
    ----------
    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, sections 5.3.2 and 5.4.3.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> sample = np.tile(np.eye(8), (4, 4))
    >>> made = intaglio.synthesize(sample, (40, 60), intaglio.QuiltOptions(block=12, cut="none"), device="cpu")
    >>> made.maps.shape
    (40, 60, 1)
    """

    block: int | str = "auto"
    overlap: int | None = None
    tolerance: float = 0.1
    cut: str = "path"
    continuation: str = "shortcut"
    refine: int = 2

    def __post_init__(self) -> None:
        object.__setattr__(self, "tolerance", checked_number("tolerance", self.tolerance, 0, _MOST_TOLERANCE))
        object.__setattr__(self, "refine", checked_count("refine", self.refine, 0, 100))
        checked_choice("cut", self.cut, CUTS)
        checked_choice("continuation", self.continuation, CONTINUATIONS)
        _check_block(self.block)
        if self.overlap is not None and (not _is_whole(self.overlap) or self.overlap < 1):
            raise InputError(f"overlap must be a whole number from 1 to block - 1, not {shown(self.overlap)}")
        check_fields(self)


@dataclass(frozen=True)
class GrowOptions:
    """Options of synthesis pixel by pixel, for `synthesize` and `synthesize_each_light`.

    `grow` takes the same options as arguments.

    Parameters
    ----------
    window : int, optional
        Radius of the neighbourhood on the pixel's own level, in pixels, 1 to 7: its side is 2 ``window`` + 1.
    levels : int, optional
        Levels of the pyramid, 1 to 12. Default None: as many as leave the coarsest sample at least four windows on a side
        and one window of usable pixels, at most 4.
    exhaustive : float, optional
        Share of the pixels that are searched for in any case, 0 to 1; for the others the pixel next to the source of their
        left neighbour is taken if there is one. Section 5.3.1 of the thesis finds 0.4 to 0.7 good enough.

    Raises
    ------
    InputError
        If a value is out of range.

    See Also
    --------
    intaglio.grow : The method, with its references.
    intaglio.QuiltOptions : The options of the other method.

    References
    ----------
    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, section 5.3.1.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> sample = np.tile(np.eye(8), (3, 3))
    >>> made = intaglio.synthesize(sample, 30, intaglio.GrowOptions(window=1, levels=1), device="cpu")
    >>> made.maps.shape
    (30, 30, 1)
    """

    window: int = 2
    levels: int | None = None
    exhaustive: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "window", checked_count("window", self.window, 1, 7))
        object.__setattr__(self, "exhaustive", checked_number("exhaustive", self.exhaustive, 0, 1))
        if self.levels is not None:
            object.__setattr__(self, "levels", checked_count("levels", self.levels, 1, 12))
        check_fields(self)


def _check_block(block: int | str) -> None:
    """Raise `InputError` unless ``block`` is "auto" or a whole number of at least 2."""
    automatic = isinstance(block, str) and block == "auto"
    if not automatic and (not _is_whole(block) or int(block) < 2):
        raise InputError(f'block must be a whole number of at least 2, or "auto", not {shown(block)}')


def _is_whole(value: object) -> bool:
    """Tell whether a value is a whole number, and no truth value."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)
