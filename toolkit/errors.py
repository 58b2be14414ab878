"""The errors that a user of Intaglio can meet: each says what is wrong and what would be right."""

from __future__ import annotations

import re

# Names in messages that are longer than this, and messages that are longer than that, lose their middle.
_LONGEST_NAME, _LONGEST_MESSAGE = 200, 2000


def _shortened(text: str, longest: int) -> str:
    """Return text without its middle, if it is longer than ``longest``."""
    return text if len(text) <= longest else f"{text[: longest // 2]}…{text[-(longest // 2) :]}"


class IntaglioError(Exception):
    """Base class of every error that Intaglio raises for bad input, files or settings.

    The message names the file or argument, says what is wrong with it, and what would be right. The `intaglio` command
    prints it without a traceback and ends with exit status 2.

    Examples
    --------
    One ``except`` clause catches all of them:

    >>> import intaglio
    >>> try:
    ...     intaglio.read_surface("missing.ply")
    ... except intaglio.IntaglioError as error:
    ...     print(error)
    missing.ply: no such file
    """

    def __str__(self) -> str:
        """Return the message as one line, in which what is very long is shortened."""
        text = "".join(c if c.isprintable() else " " for c in super().__str__().strip())
        text = re.sub(rf"\S{{{_LONGEST_NAME + 1},}}", lambda found: _shortened(found[0], _LONGEST_NAME), text)
        return _shortened(text, _LONGEST_MESSAGE)


class InputError(IntaglioError, ValueError):
    """Error about an argument, or about the content of data or a file, that can't be used.

    It is a `ValueError` as well.

    Examples
    --------
    >>> import intaglio
    >>> intaglio.Sphere(center=(0, 0, 0), radius=-1)
    Traceback (most recent call last):
        ...
    intaglio.errors.InputError: radius must be a positive length, not -1
    """


class FileError(IntaglioError, OSError):
    """Error about a file that can't be read or written, or whose content is not what its name says.

    It is an `OSError` as well.

    Examples
    --------
    >>> import intaglio
    >>> intaglio.read_image("photograph.gif")
    Traceback (most recent call last):
        ...
    intaglio.errors.FileError: photograph.gif: no such file
    """


class FitError(IntaglioError, ValueError):
    """Error about data to which no model can be fitted, or several fit equally well.

    Base shapes are fitted to points (`intaglio.fit_base`), circles to pictures of a mirror sphere
    (`intaglio.fit_circle`). It is a `ValueError` as well.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> on_a_line = np.linspace(0, 1, 10)[:, None] * [1.0, 2.0, 3.0]
    >>> intaglio.fit_base(on_a_line)
    Traceback (most recent call last):
        ...
    intaglio.errors.FitError: all points lie on a line; no base can be fitted
    """


class IntaglioWarning(UserWarning):
    """Warning about something that the user should know but that does not stop the work.

    Examples
    --------
    Half of the values of this stack are at the ceiling of their range, and the fit says so:

    >>> import warnings
    >>> import numpy as np
    >>> import intaglio
    >>> lights = [[0, 0, 1], [0.5, 0, 1], [0, 0.5, 1], [-0.5, 0, 1]]
    >>> images = np.full((4, 2, 2, 1), 0.5)
    >>> images[:2] = 1.0
    >>> stack = intaglio.PhotometricStack(images, lights)
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     texture = intaglio.represent(stack, "gradient")
    >>> print(caught[0].category.__name__, caught[0].message, sep=": ")
    IntaglioWarning: 50% of the stack's values are overexposed; fits there are not to be trusted
    """
