# SPDX-License-Identifier: Apache-2.0
"""The one decorator for compiled kernels.

numba's own file cache looks only at the file of the function itself: a changed callee in another
file would leave a stale caller behind. So the cache folder is named after the content of every
source file of the stack that holds a kernel; any change there starts an empty folder.
"""

import hashlib
import os
import tempfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

KERNEL_PACKAGES = (
    "heli_math",
    "heli_dynamics_sim",
    "heli_inner_hinf",
    "heli_observer",
    "heli_outer_pd",
    "heli_msgs_bridge",
    "heli_hover_test",
)
_MOSTLY_UNCOMPILED = ("heli_hover_test", "heli_msgs_bridge")
_KEPT_FOLDERS = 4


def _bears_on_kernels(package: str, name: str, content: bytes) -> bool:
    """Whether a change of the file could change compiled code (constants count, nodes do not)."""
    if name.endswith(("node.py", "parameter_table.py")):
        return False
    return package not in _MOSTLY_UNCOMPILED or b"njit" in content


def _source_digest() -> str:
    """Hash of every kernel-bearing source file of the stack (hex, 16 characters)."""
    digest = hashlib.sha256()
    for package in KERNEL_PACKAGES:
        spec = find_spec(package)
        if spec is None or spec.submodule_search_locations is None:
            continue
        for folder in spec.submodule_search_locations:
            for path in sorted(Path(folder).glob("*.py")):
                content = path.read_bytes()
                if _bears_on_kernels(package, path.name, content):
                    digest.update(f"{package}/{path.name}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()[:16]


def _cache_root() -> Path:
    """First writable one of the user's cache folder and the system's temporary folder."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "heli_hover"
    try:
        home.mkdir(parents=True, exist_ok=True)
        if os.access(home, os.W_OK):
            return home
    except OSError:
        return Path(tempfile.gettempdir()) / f"heli_hover-{os.getuid()}"
    return Path(tempfile.gettempdir()) / f"heli_hover-{os.getuid()}"


def _prune(root: Path, keep: Path) -> None:
    """Drop all but the newest few cache folders of earlier sources."""
    import shutil

    folders = sorted(
        (p for p in root.glob("kernels-*") if p != keep), key=lambda p: p.stat().st_mtime
    )
    for folder in folders[: max(0, len(folders) - (_KEPT_FOLDERS - 1))]:
        shutil.rmtree(folder, ignore_errors=True)


def _configure_cache() -> None:
    """Point numba at the folder that belongs to these sources, unless the user chose one."""
    if os.environ.get("NUMBA_CACHE_DIR"):
        return
    root = _cache_root()
    folder = root / f"kernels-{_source_digest()}"
    if not folder.is_dir():
        folder.mkdir(parents=True, exist_ok=True)
        _prune(root, folder)
    # Not through the environment: a child process may run other sources than we do.
    import numba

    numba.config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]


_configure_cache()


def njit(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel: nopython, cached on disk, IEEE division (x/0 is inf, not an exception).

    Deliberately without fastmath: the same inputs give the same bits in the one-process loop and in
    the nodes, and NaN checks stay meaningful.
    """
    import numba

    return numba.njit(cache=True, error_model="numpy")(function)
