# SPDX-License-Identifier: Apache-2.0
"""The site builds without a complaint, is whole, and loads nothing from elsewhere."""

import importlib.util
import re
import shutil
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = ROOT / "scripts"
# What a page loads by itself, as opposed to what a reader may follow.
LOADED = {("script", "src"), ("img", "src"), ("link", "href"), ("iframe", "src")}
FOLLOWED = {("a", "href")}
NOT_LOADED = {"canonical", "prev", "next"}


def script(name):
    """A module of scripts/."""
    sys.path.insert(0, str(SCRIPTS))
    try:
        spec = importlib.util.spec_from_file_location(name, SCRIPTS / f"{name}.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(SCRIPTS))
    return module


build_docs = script("build_docs")
docs_reference = script("docs_reference")


class Page(HTMLParser):
    """Addresses and anchors of a page."""

    def __init__(self, path):
        super().__init__()
        self.path, self.loaded, self.followed, self.anchors = path, [], [], set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        """Note what a tag names."""
        values = dict(attributes)
        self.anchors |= {values.get("id"), values.get("name")}
        for name, value in attributes:
            if (tag, name) in LOADED and values.get("rel") not in NOT_LOADED:
                self.loaded.append(value)
            elif (tag, name) in FOLLOWED:
                self.followed.append(value)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site of this checkout; built once."""
    out = tmp_path_factory.mktemp("site")
    assert build_docs.build(ROOT, out) == []
    return out


@pytest.fixture(scope="module")
def pages(site):
    return {path.resolve(): Page(path) for path in site.rglob("*.html") if path.name != "404.html"}


def test_every_link_and_anchor_leads_somewhere(site, pages):
    """Looked up in the pages themselves, apart from what the generator says."""
    checked = 0
    for page in pages.values():
        for link in page.followed:
            if re.match(r"[a-z]+:", link):
                continue
            checked += 1
            target, _, anchor = unquote(link).partition("#")
            path = (page.path.parent / target).resolve() if target else page.path.resolve()
            assert path.exists(), f"{page.path.relative_to(site)}: {link}"
            if anchor and path in pages:
                assert anchor in pages[path].anchors, f"{page.path.relative_to(site)}: {link}"
    assert checked > 1000


def test_nothing_is_loaded_from_elsewhere(pages):
    for page in pages.values():
        outside = [link for link in page.loaded if re.match(r"(https?:)?//", link)]
        assert outside == [], page.path
    for path in pages:
        assert not re.search(r"fonts\.g(oogleapis|static)", path.read_text(encoding="utf-8"))


def test_every_package_is_reached_from_the_front_page(site, pages):
    front = {(site / link.split("#")[0]).resolve() for link in pages[site / "index.html"].followed}
    for readme in ROOT.glob("src/*/README.md"):
        package = readme.parent.name
        assert (site / "src" / package / "index.html").resolve() in front
        if (readme.parent / "setup.py").is_file():
            assert (site / "reference" / f"{package}.html").resolve() in front


def test_every_markdown_page_is_in_the_site(site):
    for page in build_docs.pages(ROOT):
        name = "index.html" if page.name == "README.md" else f"{page.stem}.html"
        assert (site / page.parent / name).is_file(), page


def test_the_reference_begins_with_what_is_called_first():
    made = [Path("reference/commands.md")]
    made += [Path(f"reference/{name}.md") for name in docs_reference.in_order(["heli_x", "heli"])]
    nav = build_docs.contents(["README.md", "last"], made, ROOT)
    (reference,) = [entry["Reference"] for entry in nav if "Reference" in entry]
    assert reference[:3] == ["reference/commands.md", "reference/heli.md", "docs/ros.md"]
    headings = re.findall(r"(?m)^## (\w+)$", docs_reference.names_page("heli"))
    assert headings[0] == "fly" and len(headings) == len(set(headings))
    assert set(docs_reference.FIRST["heli"]) <= set(headings)
    assert re.search(r"(?m)^## (.+)$", docs_reference.command_page())[1] == "hover"


def test_names_with_shape_and_unit_and_commands_are_in_the_reference(site):
    text = (site / "reference/heli_inner_hinf.html").read_text(encoding="utf-8")
    for name in ("hinf_norm", "synthesize", "AttitudeConfig"):
        assert f'id="{name.lower()}"' in text
    assert "(9, 9)" in text and "<strong>Parameters</strong>" in text
    commands = (site / "reference/commands.html").read_text(encoding="utf-8")
    for command in ("hover", "bag-repair", "campaign-rare"):
        assert f'id="{command}"' in commands


def small_checkout(folder):
    """A checkout of one page beside the real site's configuration."""
    shutil.copytree(ROOT / "docs/site", folder / "docs/site")
    config = folder / build_docs.CONFIG
    text = config.read_text(encoding="utf-8")
    nav = "nav:\n  - README.md\n  - Work on it:\n      - docs/site/README.md\n"
    config.write_text(text.split("nav:\n  - README.md")[0] + nav, encoding="utf-8")
    (folder / "docs/ros.md").write_text("# Topics\n", encoding="utf-8")
    (folder / "src/heli_flight").mkdir(parents=True)
    (folder / "src/heli_flight/README.md").write_text("# Flight\n")
    (folder / "docs/packages").mkdir()
    (folder / "docs/packages/flight.md").write_text("# Flight\n\n## Commands\n")
    return folder / "README.md"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[a](docs/nothere.md)", "nothere.md"),
        ("[a](docs/ros.md#nope)", "#nope"),
        ("[a](#nope)", "#nope"),
        ("[a](/docs/ros.md)", "/docs/ros.md"),
        ("![a](nothere.png)", "nothere.png"),
    ],
)
def test_a_link_that_leads_nowhere_is_an_error(tmp_path, text, words):
    small_checkout(tmp_path).write_text(f"# A\n\n{text}\n", encoding="utf-8")
    wrong = build_docs.build(tmp_path, tmp_path / "out")
    assert len(wrong) == 1 and words in wrong[0]


def test_a_page_that_no_contents_name_is_an_error(tmp_path):
    small_checkout(tmp_path).write_text("# A\n", encoding="utf-8")
    (tmp_path / "docs/lost.md").write_text("# Lost\n", encoding="utf-8")
    (wrong,) = build_docs.build(tmp_path, tmp_path / "out")
    assert "docs/lost.md" in wrong


def test_a_list_after_a_paragraph_is_a_list_but_not_in_code():
    markdown = "a\n- b\n- c\n  d\n- e\n\n```\nx\n- y\n```\nf\n1. g\n"
    wanted = "a\n\n- b\n- c\n  d\n- e\n\n```\nx\n- y\n```\nf\n\n1. g\n"
    assert build_docs.as_on_github(markdown) == wanted


@pytest.mark.parametrize(
    ("title", "anchor"),
    [
        ("Worlds (`--world`)", "worlds---world"),
        ("The paper's own laws", "the-papers-own-laws"),
        ("gamma*", "gamma"),
        ("heli_core", "heli_core"),
    ],
)
def test_anchors_are_github_s(title, anchor):
    assert build_docs.github_anchor(title, "-") == anchor


def test_a_docstring_becomes_a_list_of_parameters():
    text = "Do *it* [m].\n\nParameters\n----------\nx : (3,) array\n    Place, m.\n"
    wanted = "Do \\*it\\* \\[m\\].\n\n**Parameters**\n\n- `x`: (3,) array  \n    Place, m."
    assert docs_reference.docstring(text) == wanted


def test_a_long_signature_is_split_at_its_own_commas_only():
    text = "a: dict[str, int] = {1, 2}, b: str = 'x, y', c=(1, 2)"
    assert list(docs_reference._split(text)) == [
        "a: dict[str, int] = {1, 2}",
        "b: str = 'x, y'",
        "c=(1, 2)",
    ]


def test_without_the_tools_the_script_says_so_in_a_line(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "mkdocs.commands.build", None)
    assert build_docs.main(["--out", str(tmp_path)]) == 2
    stderr = capsys.readouterr().err
    assert stderr.count("\n") == 1 and "./run_tests.sh installs it" in stderr
