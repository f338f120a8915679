#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Link the packages under src/ into a virtual environment, like `colcon build --symlink-install`.

Nothing is copied: a changed Python or YAML file counts at once, and compiled kernels, cached by the
path of their source, stay valid. The links are what `ros2 run`, `ros2 launch` and ament_index seek:

    <prefix>/lib/<package>/<executable>
    <prefix>/share/<package>/{package.xml,config,web}
    <prefix>/share/<package>/launch/<file>
    <prefix>/share/ament_index/resource_index/packages/<package>

a .pth file puts the Python packages on the path, and the commands of pyproject.toml's
[project.scripts] stand in <prefix>/bin. Running it again is harmless.
"""

import argparse
import shutil
import sys
import sysconfig
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SOURCES = ROOT / "src"
MARKERS = Path("share/ament_index/resource_index/packages")
PATH_FILE = "heli_hover.pth"
COMMAND = """#!{python}
import sys

from {module} import {function}

if __name__ == "__main__":
    sys.exit({function}())
"""


def packages() -> list[Path]:
    """Folders of the Python packages under src/, in alphabetical order."""
    return sorted(setup.parent for setup in SOURCES.glob("*/setup.py"))


def _fresh_folder(folder: Path) -> None:
    """Make the folder, empty of what an earlier run linked into it."""
    if folder.is_symlink():
        folder.unlink()
    elif folder.exists():
        shutil.rmtree(folder)
    folder.mkdir(parents=True)


def _link(link: Path, target: Path) -> None:
    """Point link at target, whatever stood there."""
    link.parent.mkdir(parents=True, exist_ok=True)
    link.unlink(missing_ok=True)
    link.symlink_to(target)


def link_package(package: Path, prefix: Path) -> None:
    """Link one package's executables, share folder and index marker under prefix."""
    share = prefix / "share" / package.name
    _fresh_folder(share)
    for name in ("package.xml", "config", "web"):
        if (package / name).exists():
            _link(share / name, package / name)
    # File by file: `ros2 launch` looks for a launch file without following links to folders.
    for file in sorted((package / "launch").glob("*.launch.py")):
        _link(share / "launch" / file.name, file)
    executables = sorted((package / "scripts").glob("*"))
    if executables:
        _fresh_folder(prefix / "lib" / package.name)
    for executable in executables:
        _link(prefix / "lib" / package.name / executable.name, executable)
    _link(prefix / MARKERS / package.name, package / "resource" / package.name)


def _drop_stale_markers(prefix: Path) -> None:
    """Forget packages that an earlier run linked and that are gone from src/."""
    for marker in (prefix / MARKERS).glob("*"):
        if marker.is_symlink() and not marker.exists():
            marker.unlink()


def write_commands(prefix: Path) -> None:
    """Write the commands that `pip install .` would make, run by the running interpreter."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for name, target in project["scripts"].items():
        module, function = target.split(":")
        command = prefix / "bin" / name
        command.parent.mkdir(parents=True, exist_ok=True)
        text = COMMAND.format(python=sys.executable, module=module, function=function)
        command.write_text(text, encoding="utf-8")
        command.chmod(0o755)


def main() -> int:
    """Link every package; the prefix is the running interpreter's environment unless given."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--prefix", type=Path, default=Path(sys.prefix))
    parser.add_argument(
        "--site-packages", type=Path, default=Path(sysconfig.get_paths()["purelib"])
    )
    arguments = parser.parse_args()
    if arguments.prefix == Path(sys.base_prefix):
        parser.error("run it with the Python of a virtual environment, or give --prefix")
    for package in packages():
        link_package(package, arguments.prefix)
    write_commands(arguments.prefix)
    _drop_stale_markers(arguments.prefix)
    lines = "".join(f"{package}\n" for package in packages())
    (arguments.site_packages / PATH_FILE).write_text(lines, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
