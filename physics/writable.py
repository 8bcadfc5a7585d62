"""Whether a file or a folder can be written: asked before the minutes that its content takes."""

import errno
import tempfile
from pathlib import Path


def check_file(path: Path, *, folders: bool = True) -> None:
    """OSError: no file of this name can be written. Nothing is left behind.

    folders  those above it are made later where they are missing
    """
    try:
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, "this is a folder, expected the name of a file")
        if path.is_file():
            with path.open("ab"):
                return
        if not path.exists():  # neither a pipe nor a terminal
            _check_room(path.parent, folders)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def check_folder(path: Path) -> None:
    """OSError: nothing can be written to this folder, or it cannot be made. Nothing is left behind."""
    try:
        _check_room(path, folders=True)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def _check_room(folder: Path, folders: bool) -> None:
    """OSError: nothing can be written to this folder, or to the nearest one above it that there is."""
    while folders and not folder.exists() and folder != folder.parent:
        folder = folder.parent
    with tempfile.TemporaryFile(dir=folder):
        pass
