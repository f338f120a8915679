# SPDX-License-Identifier: Apache-2.0
"""Folders that this user alone may write to, also in a place that all users of a machine share;
files that are there whole or not at all.

Machine code of kernels is loaded from such a folder, and a module by a file of matplotlib's: who
can write there runs code as this user. A name in the temporary folder can be foreseen, so whoever
comes first may have made it: it is used only if it is a folder, no link, and this user's.
"""

import atexit
import contextlib
import os
import shutil
import stat
import tempfile
from functools import cache
from pathlib import Path

_ALL_OTHERS = stat.S_IWGRP | stat.S_IWOTH
_FRESH = "HELI_PRIVATE_FOLDER"
"""Names the fresh folder of a process to those that it starts (environment)."""


def make_private(path: Path) -> bool:
    """Make a folder (its parent exists), or take it if it is this user's; False if it is not.

    What others of this user's group may write to, as an old umask left it, is closed to them.
    """
    with contextlib.suppress(OSError):
        os.mkdir(path, 0o700)
    try:
        # By its descriptor: a name may be given to another folder between two looks.
        folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return False
    try:
        state = os.fstat(folder)
        if state.st_uid != os.getuid():
            return False
        if state.st_mode & _ALL_OTHERS:
            os.fchmod(folder, stat.S_IMODE(state.st_mode) & ~_ALL_OTHERS)
        return True
    except OSError:
        return False
    finally:
        os.close(folder)


def others_may_replace(path: Path) -> bool:
    """Whether another user may put something else in place of what lies in a folder.

    In one that others may write to, unless it is sticky; of a group that is not this user's first.
    Also by way of a folder above it. OSError: there is none.
    """
    for folder in (path := path.resolve(strict=True), *path.parents):
        state = folder.stat()
        others = state.st_mode & stat.S_IWOTH
        group = state.st_mode & stat.S_IWGRP and state.st_gid != os.getgid()
        if (others or group) and not state.st_mode & stat.S_ISVTX:
            return True
    return False


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file that is there whole or, as on a full disk, stays what it was.

    Raises
    ------
    OSError
        It names the file.
    """
    raw = content.encode() if isinstance(content, str) else content
    try:
        target = path.resolve()
        if target.exists() and not target.is_file():  # a pipe, or /dev/null
            target.write_bytes(raw)
            return
        beside = target.with_name(f".{target.name}.{os.getpid()}")
        try:
            beside.write_bytes(raw)
            beside.replace(target)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error


@cache
def _fresh() -> Path:
    """A new folder with a name that nobody can foresee, gone when this process ends."""
    named = os.environ.get(_FRESH)
    if named and make_private(Path(named)):
        return Path(named)
    fresh, maker = tempfile.mkdtemp(prefix="heli_hover-"), os.getpid()
    os.environ[_FRESH] = fresh

    def remove() -> None:
        if os.getpid() == maker:
            shutil.rmtree(fresh, ignore_errors=True)

    atexit.register(remove)
    return Path(fresh)


def temporary_folder(name: str) -> Path:
    """This user's folder of a name in the temporary folder; made where it is missing.

    It is the same one from run to run, unless somebody else has taken its place: then it is a fresh
    one, for this process and those that it starts.

    Raises
    ------
    OSError
        The temporary folder cannot be written to.
    """
    place = Path(tempfile.gettempdir()) / f"heli_hover-{os.getuid()}"
    if not make_private(place) or not make_private(place / name):
        place = _fresh()
        (place / name).mkdir(mode=0o700, exist_ok=True)
    return place / name
