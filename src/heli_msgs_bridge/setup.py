# SPDX-License-Identifier: Apache-2.0
"""Build by colcon; `pip install .` at the top of the repository installs all packages at once."""

from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "heli_msgs_bridge"


def shared(top, pattern):
    """Data files under top, subfolders too, as (install folder, files)."""
    folders = [Path(top), *(path for path in Path(top).rglob("*") if path.is_dir())]
    return [
        (
            f"share/{PACKAGE}/{folder}",
            [str(path) for path in folder.glob(pattern) if path.is_file()],
        )
        for folder in sorted(folders)
    ]


setup(
    name=PACKAGE,
    version="0.1.0",
    maintainer="heli-hover maintainers",
    maintainer_email="maintainers@example.org",
    license="Apache-2.0",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        *shared("config", "*.yaml"),
        *shared("config", "*.json"),
        *shared("launch", "*.launch.py"),
        *shared("web", "*"),
        (f"lib/{PACKAGE}", [str(path) for path in Path("scripts").glob("*")]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
)
