# SPDX-License-Identifier: Apache-2.0
"""Build by colcon, bloom or pip; the package stands alone. Written by scripts/ros_package.py.

Name, version, description, maintainer and licence stand in package.xml; what is installed follows
from the folders that the package has.
"""

from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

SHARED = ("config", "launch", "web")


def data_files(package: str) -> list[tuple[str, list[str]]]:
    """(install folder, files) of the package in the present folder, as ament_index seeks them."""
    found = [
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
    ]
    for top in SHARED:
        for folder in sorted({path.parent for path in Path(top).rglob("*.*")}):
            files = sorted(str(path) for path in folder.glob("*.*") if path.suffix != ".pyc")
            found.append((f"share/{package}/{folder}", files))
    executables = sorted(str(path) for path in Path("scripts").glob("*"))
    if executables:
        found.append((f"lib/{package}", executables))
    return found


manifest = ElementTree.parse("package.xml").getroot()
name, maintainer = manifest.findtext("name"), manifest.find("maintainer")
setup(
    name=name,
    version=manifest.findtext("version"),
    description=manifest.findtext("description"),
    maintainer=maintainer.text,
    maintainer_email=maintainer.get("email"),
    license=manifest.findtext("license"),
    packages=find_packages(exclude=["test"]),
    package_data={"": ["page/*"]},
    data_files=data_files(name),
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
)
