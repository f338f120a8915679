# SPDX-License-Identifier: Apache-2.0
"""The version that all packages share: that of package.xml, in a source tree or installed."""

import re

from heli_core.command_line import share_folder

_TAG = re.compile(r"<version>([^<]+)</version>")


def version() -> str:
    """The version, such as 0.1.0.

    Raises
    ------
    MissingFileError
        The package is installed without its data files.
    """
    manifest = (share_folder("heli_core") / "package.xml").read_text(encoding="utf-8")
    found = _TAG.search(manifest)
    return found[1] if found else ""


__version__ = version()
