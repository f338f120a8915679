#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Write what is the same in all Python packages under src/: setup.py and setup.cfg.

colcon, bloom and rosdep want a package that can be built alone, so each has a copy; of setup.py
the one to edit is scripts/ros_setup.py. (`pip install .` at the top of the repository uses
pyproject.toml instead and installs all packages at once.)
"""

from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SETUP_CFG = """# SPDX-License-Identifier: Apache-2.0
[develop]
script_dir=$base/lib/{name}
[install]
install_scripts=$base/lib/{name}
"""


def files(name: str) -> dict[str, str]:
    """File name to text, of the package of this name."""
    setup = (ROOT / "scripts/ros_setup.py").read_text(encoding="utf-8")
    return {"setup.py": setup, "setup.cfg": SETUP_CFG.format(name=name)}


def main() -> None:
    """Write them into every package that has a setup.py."""
    for package in sorted(path.parent for path in ROOT.glob("src/*/setup.py")):
        for name, text in files(package.name).items():
            (package / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
