# SPDX-License-Identifier: Apache-2.0
"""What a process that was killed leaves in shared memory: Fast DDS does not take it away again.

Each participant has a segment of half a megabyte, `fastrtps_` and 16 digits, and beside it a file
with `_el` behind the name, on which it holds a lock (flock) for as long as it lives. Whose lock is
free is dead. Ports (`fastrtps_port...`) are left to Fast DDS: the next process with the same number
takes them over.
"""

import contextlib
import fcntl
import os
import re
import time
from collections.abc import Callable
from pathlib import Path

FOLDER = Path("/dev/shm")
_LOCK = re.compile(r"(fastrtps_[0-9a-f]{16})_el")
# Who is about to begin has its file before its lock.
_YOUNG_S = 2.0


def remove_left(folder: Path = FOLDER, now_s: Callable[[], float] = time.time) -> list[str]:
    """Remove this user's segments whose process is dead, and their lock files.

    Parameters
    ----------
    folder : Path
        Where they are.
    now_s : callable, optional
        Time of the files' clock, s.

    Returns
    -------
    list of str
        Names of the segments.
    """
    gone = []
    for lock in sorted(folder.glob("fastrtps_*_el")):
        found = _LOCK.fullmatch(lock.name)
        # What others remove meanwhile, or did not let us have, is not ours to remove.
        with contextlib.suppress(OSError):
            if found and _is_left(lock, now_s()):
                (folder / found[1]).unlink(missing_ok=True)
                lock.unlink()
                gone.append(found[1])
    return gone


def _is_left(lock: Path, now_s: float) -> bool:
    status = lock.stat()
    if status.st_uid != os.getuid() or now_s - status.st_mtime < _YOUNG_S:
        return False
    descriptor = os.open(lock, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    finally:
        os.close(descriptor)
    return True
