# SPDX-License-Identifier: Apache-2.0
"""The git commit of the sources that run, where they are a git work tree."""

import functools
import os
import subprocess
from pathlib import Path

UNKNOWN = "unknown"
_CHANGED = " with local changes"
_LIMIT_S = 5.0


@functools.cache
def sources_commit() -> str:
    """Commit of this file's work tree, 40 digits, and whether files were changed since.

    "unknown" without git, in an installed copy, and in somebody else's repository.
    """
    here = Path(__file__).resolve()
    try:
        _git(here.parent, "ls-files", "--error-unmatch", here.name)
        text = _git(
            here.parent, "describe", "--always", "--abbrev=40", "--exclude=*", f"--dirty={_CHANGED}"
        )
    except (OSError, subprocess.SubprocessError):
        return UNKNOWN
    return text.strip() or UNKNOWN


def is_another(commit: str) -> bool:
    """Whether a commit of `sources_commit` is known not to be that of the present sources."""
    theirs, ours = commit.removesuffix(_CHANGED), sources_commit().removesuffix(_CHANGED)
    return bool(theirs) and UNKNOWN not in (theirs, ours) and theirs != ours


def _git(folder: Path, *words: str) -> str:
    # A hook's or a rebase's own GIT_DIR must not lead to another repository.
    env = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    command = ["git", "--no-optional-locks", "-C", str(folder), *words]
    done = subprocess.run(
        command, env=env, capture_output=True, text=True, timeout=_LIMIT_S, check=True
    )
    return done.stdout
