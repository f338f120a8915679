# SPDX-License-Identifier: Apache-2.0
"""The notebooks run, say what is stored in them, and are pages of the site."""

import copy
import importlib.util
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "examples/notebooks"
BOOKS = sorted(FOLDER.glob("*.ipynb"))


def script(name):
    """A module of scripts/."""
    spec = importlib.util.spec_from_file_location(name, ROOT / f"scripts/{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


notebooks, docs_notebooks = script("notebooks"), script("docs_notebooks")


def stored(path):
    return nbformat.read(path, as_version=4)


def test_there_are_six_and_the_page_beside_them_names_each():
    text = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert len(BOOKS) == 6
    assert [f"]({path.name})" in text for path in BOOKS] == [True] * 6


@pytest.mark.slow
@pytest.mark.parametrize("path", BOOKS, ids=lambda path: path.stem)
def test_a_fresh_run_says_what_is_stored(path):
    """In a kernel of its own, as Jupyter runs it; words, and numbers to their last digit."""
    assert notebooks.check(path) == []


@pytest.mark.parametrize("path", BOOKS, ids=lambda path: path.stem)
def test_what_is_stored_is_whole_and_tidy(path):
    book = stored(path)
    nbformat.validate(book)
    assert nbformat.writes(notebooks.tidied(copy.deepcopy(book))) == nbformat.writes(book)
    assert "\n".join(c.source for c in book.cells).count("import heli\n") == 1
    drawn = [
        o for c in book.cells for o in c.get("outputs", []) if "image/png" in o.get("data", {})
    ]
    assert drawn
    for cell in book.cells:  # else a text that comes in two messages would be another one
        assert sum(o.output_type == "stream" for o in cell.get("outputs", [])) <= 1, cell.id
    assert all(cell.execution_count for cell in book.cells if cell.cell_type == "code")


@pytest.mark.parametrize(
    ("one", "two", "alike"),
    [
        ("error 0.123 m", "error 0.124 m", True),
        ("error 0.123 m", "error 0.126 m", False),
        ("-0.0 %", "+0.0 %", True),
        ("12 of 12 inside", "11 of 12 inside", False),
        ("inside 0.3", "OUTSIDE 0.3", False),
        ("1.5e-12", "1.6e-12", True),
        ("1.5e-12", "1.5e-11", False),
        ("1 2", "1 2 3", False),
        ("seed 3", "seed 3 ", True),
    ],
)
def test_words_are_compared_as_they_stand_and_numbers_by_their_last_digit(one, two, alike):
    assert notebooks.same(one, two) is alike


def test_a_missing_output_or_another_number_is_told():
    book = stored(BOOKS[0])
    assert list(notebooks.differences(book, copy.deepcopy(book))) == []
    fresh = copy.deepcopy(book)
    cell = next(c for c in fresh.cells if c.get("outputs"))
    kept = cell.outputs.pop()
    assert len(list(notebooks.differences(book, fresh))) == 1
    kept.data["text/plain"] = kept.data["text/plain"].replace("0.18", "0.28")
    cell.outputs.append(kept)
    (line,) = notebooks.differences(book, fresh)
    assert line.startswith(f"{cell.id}, text/plain")


def test_what_is_told_of_the_run_is_left_out():
    """How long something takes depends on the machine, and on what it has compiled already."""
    book = stored(BOOKS[0])
    fresh = copy.deepcopy(book)
    cell = next(c for c in fresh.cells if c.get("outputs"))
    page = """<pre style="white-space:pre;overflow-x:auto">compiles: once</pre>"""
    progress = {"text/html": page, "text/plain": "compiles: once"}
    cell.outputs.insert(0, nbformat.v4.new_output("display_data", progress))
    cell.outputs.insert(0, nbformat.v4.new_output("stream", name="stderr", text="1 of 3"))
    assert list(notebooks.differences(book, notebooks.tidied(fresh))) == []


def test_a_page_has_words_code_and_what_it_gave():
    text, pictures = docs_notebooks.notebook_page(BOOKS[0])
    book = stored(BOOKS[0])
    assert text.count("```python") == sum(c.cell_type == "code" for c in book.cells)
    assert all(content.startswith(b"\x89PNG") for content in pictures.values())
    assert all(f"]({name})" in text for name in pictures) and pictures
    assert "<table>" in text
    linked = docs_notebooks.with_page_links("[a](x/02_your_law.ipynb#write-one) [b](../my_law.py)")
    assert linked == "[a](x/02_your_law.md#write-one) [b](../my_law.py)"
