"""The errors that a user of Intaglio can meet, each naming the culprit and the cure."""

from __future__ import annotations


class IntaglioError(Exception):
    """Base of every error raised for bad input, files or settings."""


class InputError(IntaglioError, ValueError):
    """An argument or the content of the data is not usable."""


class FileError(IntaglioError, OSError):
    """A file can't be read or written, or isn't what its name says."""


class FitError(IntaglioError, ValueError):
    """No base shape fits the points, or several fit equally well."""


class IntaglioWarning(UserWarning):
    """Something the user should know but that does not stop the work."""
