"""The `intaglio` command: thin layers over the public functions."""

from intaglio.cli.running import main, run

__all__ = ["main", "run"]
