# SPDX-License-Identifier: Apache-2.0
"""Whether a bag is whole, in words for the user; found without reading its messages."""

from pathlib import Path

import yaml
from mcap.writer import MCAP0_MAGIC

from heli_bags.folder import METADATA, SUFFIXES


def storage_files(bag: Path) -> list[Path]:
    """The .mcap and .db3 files of a folder."""
    return sorted(p for p in bag.iterdir() if p.suffix in SUFFIXES.values() and p.is_file())


def listed_files(bag: Path) -> list[str]:
    """Names of the files that metadata.yaml lists; empty if there is none that can be read."""
    try:
        content = yaml.safe_load((bag / METADATA).read_text(encoding="utf-8"))
        paths = content["rosbag2_bagfile_information"]["relative_file_paths"]
        return [Path(str(path)).name for path in paths]
    except (OSError, ValueError, TypeError, LookupError, RecursionError, yaml.YAMLError):
        return []


def _file_trouble(path: Path) -> str:
    if path.suffix == ".mcap":
        with open(path, "rb") as stream:
            if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                return f"{path.name} is no MCAP file"
            size = path.stat().st_size
            stream.seek(max(0, size - len(MCAP0_MAGIC)))
            whole = size > 2 * len(MCAP0_MAGIC) and stream.read() == MCAP0_MAGIC
        return "" if whole else f"{path.name} is cut off"
    for tail in ("-wal", "-journal"):
        log = path.with_name(path.name + tail)
        if log.is_file() and log.stat().st_size:
            return f"{path.name} was never closed"
    return ""


def trouble(bag: Path) -> str:
    """What is wrong with a bag that `heli bag repair` can restore; empty if nothing is.

    Parameters
    ----------
    bag : Path
        rosbag2 folder or a storage file.
    """
    files = [bag] if bag.is_file() else storage_files(bag)
    for path in files:
        found = _file_trouble(path)
        if found:
            return found
    if bag.is_file() or not files:
        return ""
    if not (bag / METADATA).is_file():
        return f"{METADATA} is missing"
    listed = listed_files(bag)
    absent = [name for name in listed if not (bag / name).is_file()]
    if absent:
        return f"{', '.join(absent)} of {METADATA} is missing"
    unlisted = {path.name for path in files} - set(listed)
    if unlisted:
        return f"{METADATA} does not list {', '.join(sorted(unlisted))}"
    return ""


def advice(bag: Path) -> str:
    """One sentence on what is wrong and what restores it; empty if nothing is."""
    found = trouble(bag)
    return f"{found}; 'heli bag repair {bag}' restores what can be" if found else ""
