# SPDX-License-Identifier: Apache-2.0
"""Files and links that documents name exist; the house is drawn as it is checked."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = sorted(
    str(path.relative_to(ROOT))
    for pattern in ("*.md", "docs/**/*.md", "src/*/README.md")
    for path in ROOT.glob(pattern)
)
ARCHITECTURE = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]


@pytest.mark.parametrize("name", DOCUMENTS)
def test_links_lead_somewhere(name):
    path = ROOT / name
    for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", path.read_text(encoding="utf-8")):
        if not re.match(r"[a-z]+:", target):
            assert (path.parent / target).exists(), f"{name}: {target}"


def test_files_of_the_walk_exist():
    """`package/file.py`, and after it `file.py` of the same package, with the functions named."""
    walks = re.findall(r"(?ms)^## (?:One tick|Life of a flight)(.*?)^## ", ARCHITECTURE)
    assert len(walks) == 2
    for line in "".join(walks).splitlines():
        package = None
        for words, functions in re.findall(r"`([\w/]+\.py)`(?: \(([^)]*)\))?", line):
            if (ROOT / words).is_file():
                continue
            *folders, name = words.split("/")
            package = folders[0] if folders else package
            file = ROOT / "src" / package / package / Path(*folders[1:]) / name
            assert file.is_file(), words
            for function in re.findall(r"`(\w+)`", functions):
                assert re.search(rf"(def|class) {function}\b", file.read_text()), function


def test_every_package_and_wing_is_in_the_picture_and_in_the_contracts():
    packages = {path.parent.name for path in (ROOT / "src").glob("*/setup.py")}
    assert packages == set(CONTRACTS["root_packages"])
    picture = ARCHITECTURE.split("```mermaid")[1].split("```")[0]
    assert packages <= set(re.findall(r"\bheli(?:_\w+)?", picture))
    wings = {p.parent.name for p in (ROOT / "src/heli_flight/heli_flight").glob("*/__init__.py")}
    # `graph` is a word of Mermaid's own, so that wing's box has another name than its label.
    drawn = re.sub(r'\w+\["(\w+)"\]', r"\1", picture)
    chain = re.search(r"cli --> .*", drawn)[0].split(" --> ")
    assert wings == set(chain)
    order = next(c["layers"] for c in CONTRACTS["contracts"] if "wings" in c["name"])
    assert [layer for layer in order if layer in wings] == chain


def test_an_order_to_fly_walks_fifteen_rooms_at_most():
    walk = ARCHITECTURE.split("## Life of a flight")[1].split("\n## ")[0]
    rooms = re.findall(r"`([\w/]+\.py)`", walk.split("In one process")[0])
    assert len(rooms) <= 15
