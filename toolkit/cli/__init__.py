"""The `intaglio` command: thin layers over the public functions."""

from intaglio.cli.entry import main

__all__ = ["main"]
