"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import secrets
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from intaglio.arrays import PathLike
from intaglio.checks import checked_path
from intaglio.errors import FileError
from intaglio.files.guard import (
    check_not_read,
    forget_read,
    note_planned,
    note_read,
    note_written,
    settling,
    tell_made,
    unfinished,
)


def check_readable(path: PathLike) -> Path:
    """Return ``path`` as a Path, or raise `FileError` saying why it can't be read."""
    path = checked_path("path", path)
    try:
        exists = path.exists()
    except (OSError, ValueError) as error:
        raise FileError(f"{path}: is no usable file name ({error})") from error
    if not exists:
        raise FileError(f"{path}: no such file")
    if path.is_dir():
        raise FileError(f"{path}: is a folder, a file is needed")
    if not os.access(path, os.R_OK):
        raise FileError(f"{path}: may not be read (permissions)")
    if not path.is_file():
        raise FileError(f"{path}: is no ordinary file but a device or pipe; give a file that can be read more than once")
    if path.stat().st_size == 0:
        raise FileError(f"{path}: the file is empty")
    note_read(path)
    return path


def check_writable(path: PathLike, *, inputs: tuple[PathLike, ...] = ()) -> Path:
    """Return ``path`` as a Path, or raise `FileError` if it can't be written: called before the work, not after it.

    Parameters
    ----------
    path : path
        The file that will be written; its folder must exist.
    inputs : tuple of path
        Files that must not be overwritten.
    """
    path = Path(path)
    try:
        path.exists()
    except (OSError, ValueError) as error:
        raise FileError(f"{path}: is no usable file name ({error})") from error
    if path.is_dir():
        raise FileError(f"{path}: is a folder; give the name of a file in it")
    folder = path.parent
    if not folder.is_dir():
        raise FileError(f"{path}: the folder {folder} does not exist; make it first")
    for given in inputs:
        if path.exists() and Path(given).exists() and os.path.samefile(path, given):
            raise FileError(f"{path}: is one of the inputs; inputs are never overwritten, give another output")
    check_not_read(path)
    note_planned(path)
    if path.exists() and not path.is_file():
        raise FileError(f"{path}: is no ordinary file but a device or pipe; give the name of a file")
    try:
        # The only sure test, also for root and on read-only file systems.
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise FileError(f"{path}: the folder {folder} can't be written to ({error.strerror})") from error
    if path.exists() and not os.access(path, os.W_OK):
        raise FileError(f"{path}: exists and may not be overwritten (permissions)")
    return path


def _give_usual_permissions(path: Path) -> None:
    """Set the permissions of an ordinary new file or folder; temporary ones are readable by their owner only."""
    umask = os.umask(0)
    os.umask(umask)
    os.chmod(path, (0o777 if path.is_dir() else 0o666) & ~umask)


def check_folder(path: PathLike) -> Path:
    """Return ``path`` as a Path, or raise `FileError` if it is neither a writable folder nor can become one."""
    path = checked_path("folder", path)
    try:
        exists = path.exists()
    except OSError as error:
        raise FileError(f"{path}: is no usable folder name ({error.strerror})") from error
    if exists and not path.is_dir():
        raise FileError(f"{path}: is a file; give a folder")
    nearest = path
    while not nearest.exists() and nearest != nearest.parent:
        nearest = nearest.parent
    try:
        with tempfile.TemporaryFile(dir=nearest):
            pass
    except OSError as error:
        raise FileError(f"{path}: the folder {nearest} can't be written to ({error.strerror})") from error
    return path


@contextmanager
def whole_folder(folder: PathLike) -> Iterator[Path]:
    """Give an empty temporary folder inside ``folder`` whose content is moved into ``folder`` at the end, all or nothing.

    Files and folders of the same names are replaced, others stay. A folder that had to be made goes again if anything fails.

    Raises
    ------
    FileError
        If ``folder`` can't be made or written to, a file would replace a folder or the other way round, a file that was read
        would be replaced, or writing fails.
    """
    folder = check_folder(folder)
    missing = [p for p in (folder, *folder.parents) if not p.exists()]
    for made in missing:
        tell_made(made)
    try:
        with unfinished(folder / f".part-{secrets.token_hex(8)}") as beside:
            inside = beside / "new"
            inside.mkdir(parents=True)
            yield inside
            new = sorted(inside.iterdir())
            for path in new:
                target = folder / path.name
                if target.exists() and (target.is_dir() != path.is_dir() or target.is_symlink()):
                    what = "folder" if path.is_dir() else "file"
                    raise FileError(f"{target}: is in the way and not a {what}; move it elsewhere")
                # A folder is replaced with all that lies in it.
                for file in [target, *target.rglob("*")] if target.is_dir() else [target]:
                    check_not_read(file)
            with settling():
                for path in new:
                    _give_usual_permissions(path)
                    target = folder / path.name
                    if target.is_dir():
                        os.replace(target, beside / f"old-{path.name}")
                    os.replace(path, target)
                    note_written(target)
    except OSError as error:
        if isinstance(error, FileError):
            raise
        raise FileError(f"{folder}: could not be written to ({error.strerror or error})") from error
    finally:
        _remove_empty(missing)


def _remove_empty(folders: list[Path]) -> None:
    """Remove folders, inner ones first, as far as they are empty."""
    for folder in folders:
        try:
            folder.rmdir()
        except OSError:
            return


@contextmanager
def whole_file(path: PathLike) -> Iterator[Path]:
    """Give a temporary path beside ``path``, which is renamed to ``path`` at the end, or removed if anything fails.

    Where ``path`` is a link, the file that it leads to is written, and the link stays.

    Raises
    ------
    FileError
        If writing fails, as on a full disk; ``path`` is then as it was.
    """
    path = check_writable(path)
    target = path.resolve() if path.is_symlink() else path
    try:
        with unfinished(target.with_name(f".part-{secrets.token_hex(8)}{path.suffix}")) as beside:
            # Nobody else reads it while it is being written.
            os.close(os.open(beside, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
            yield beside
            check_not_read(target)
            # What was written may have been read again, by a library that checks or completes it; it is no input for that.
            forget_read(beside)
            _give_usual_permissions(beside)
            os.replace(beside, target)
            note_written(target)
    except OSError as error:
        if isinstance(error, FileError):
            raise
        raise FileError(f"{path}: could not be written ({error.strerror or error})") from error
