# SPDX-License-Identifier: Apache-2.0
"""Where the page's files are. No ROS."""

from pathlib import Path

from heli_parameters import locate


def web_folder() -> Path:
    """Folder with the page.

    Raises
    ------
    MissingFileError
        The page is not installed.
    """
    folder = locate.share_folder("heli_live_view") / "web"
    if not (folder / "index.html").is_file():
        raise locate.MissingFileError(f"the page is not installed: no {folder}/index.html")
    return folder
