# SPDX-License-Identifier: Apache-2.0
"""CONTRIBUTING, "To add a package": a neighbour's packaging, named in pyproject.toml."""

import pytest

NEW = "heli_winch"
NEIGHBOUR = "heli_studies"
MODULE = '''# SPDX-License-Identifier: Apache-2.0
"""Length of the cable."""

from heli_core.jit import njit


@njit
def length_m(turns):
    """Length (m) that is out after so many turns of the drum."""
    return 0.25 * turns
'''
INIT = '''# SPDX-License-Identifier: Apache-2.0
"""A winch under the helicopter."""

from heli_core.faces import face

__getattr__, __dir__, __all__ = face(__name__, {}, modules=["cable"])
'''
README = f"# {NEW}\n\n## Purpose\nA winch.\n\n## Public names\n`cable`.\n"


def add_package(copy, data_files=True, imports="heli_core", readme=README):
    """The recipe's steps."""
    folder = f"src/{NEW}"
    for name in ("setup.py", "setup.cfg", "package.xml", "CHANGELOG.rst"):
        text = copy.path(f"src/{NEIGHBOUR}/{name}").read_text()
        copy.write(f"{folder}/{name}", text.replace(NEIGHBOUR, NEW))
    manifest = copy.path(f"{folder}/package.xml").read_text().splitlines(keepends=True)
    kept = [line for line in manifest if "exec_depend" not in line or f">{imports}<" in line]
    copy.write(f"{folder}/package.xml", "".join(kept))
    copy.write(f"{folder}/resource/{NEW}", "")
    copy.write(f"{folder}/{NEW}/__init__.py", INIT)
    copy.write(f"{folder}/{NEW}/cable.py", MODULE)
    copy.write(f"{folder}/README.md", readme)
    last = f'{NEIGHBOUR} = "src/{NEIGHBOUR}/{NEIGHBOUR}"\n'
    copy.replace("pyproject.toml", last, f'{last}{NEW} = "src/{NEW}/{NEW}"\n')
    where = f'    "src/{NEIGHBOUR}",\n'
    copy.replace("pyproject.toml", where, f'{where}    "src/{NEW}",\n')
    if data_files:
        share = f'"share/{NEIGHBOUR}" = ["src/{NEIGHBOUR}/package.xml"]\n'
        copy.replace("pyproject.toml", share, share + share.replace(NEIGHBOUR, NEW))


@pytest.mark.slow
def test_a_new_package_is_found_installed_and_compiled(copy):
    add_package(copy)
    copy.packaging("test_packaging_manifests.py", "test_packaging_layout.py", "-k", NEW)
    copy.packaging("test_packaging_faces.py", "-k", NEW)
    code = f"from {NEW} import cable; print(cable.length_m(8.0))"
    assert copy.run("-c", code).stdout.strip() == "2.0"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("forgotten", "test_file"),
    [({"data_files": False}, "test_packaging_layout.py"),
     ({"imports": "nothing"}, "test_packaging_manifests.py"),
     ({"readme": "A winch.\n"}, "test_packaging_faces.py")],
)  # fmt: skip
def test_what_was_forgotten_is_told(copy, forgotten, test_file):
    add_package(copy, **forgotten)
    assert NEW in copy.packaging(test_file, "-k", NEW, code=1).stdout
