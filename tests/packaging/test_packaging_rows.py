# SPDX-License-Identifier: Apache-2.0
"""House rule: a row of numbers has named places. Nobody writes nav[22:25], y[16] or x9[0].

The search takes every subscript in the sources of packages and scripts for one of a row if it has
a number above 2, counts from one, or cuts between two. Single numbers up to 2 are taken for
components of vectors and entries of small matrices, unless the name is that of a row.
"""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SRC = ROOT / "src"
ROWS = {
    "nav", "truth", "x9", "r3", "setpoint", "ref", "reference", "x_trim", "noise", "noise_row",
    "fix", "block", "imu",
}  # fmt: skip
"""Names that rows have in the sources: no number at all stands behind them."""
QUATERNIONS = {"q", "q_nb", "q_xyzw"}
ALGEBRA = {"heli_core/rotations.py"}
"""Files that multiply quaternions, component by component."""
TEXT = {
    "heli_flight/cli/app.py": {"Path(__file__).resolve().parents[4]"},
    "heli_bags/repair.py": {"raw[:4]"},
    "heli_flight/settings.py": {"commit[:12]", "sources_commit()[:12]"},
    "heli_flight/report/figures.py": {"textwrap.wrap(conditions, 142)[:3]"},
    "evidence/markdown.py": {
        "match[3]", "match[4]", "match[5]", "content['commit'][:10]",
    },
    "heli_analysis/identification/model.py": {"name[2:-1]"},
    "heli_core/jit.py": {"digest.hexdigest()[:16]"},
    "heli_core/parameters.py": {"text[:77]"},
    "scripts/bench_recorder.py": {"fields[11]", "fields[12]"},
    "evidence/experiments/deviations.py": {"row[4]"},
    "scripts/write_inner_loop_yaml.py": {"sys.argv[1:3]"},
}  # fmt: skip
"""Bytes, letters, words, lines and groups of a pattern: no rows."""


def number(node):
    """Value of an integer literal, also of a negative one; None for anything else."""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        value = number(node.operand)
        return None if value is None else -value
    if isinstance(node, ast.Constant) and type(node.value) is int:
        return node.value
    return None


def high(node, least=3):
    value = number(node)
    return value is not None and value >= least


def is_numeric(index, least=3):
    """Whether one part of a subscript tells places by their numbers."""
    if isinstance(index, ast.Slice):
        ends = [end for end in (index.lower, index.upper) if number(end) is not None]
        return len(ends) == 2 or any(high(end, least) for end in ends)
    if isinstance(index, ast.List | ast.Tuple):
        return any(is_numeric(entry, least) for entry in index.elts)
    if isinstance(index, ast.BinOp):
        return high(index.left) or high(index.right)
    return high(index, least)


def name_of(node):
    """Last name of what is subscripted: `reference` of track.reference."""
    return getattr(node, "attr", getattr(node, "id", ""))


def numeric_subscripts(source):
    """(line, text) of all subscripts that tell places of a row by their numbers."""
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Subscript):
            continue
        name = name_of(node.value)
        parts = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        least = 0 if name in ROWS else 4 if name in QUATERNIONS else 3
        if any(is_numeric(part, least) for part in parts):
            yield node.lineno, ast.unparse(node)


def sources():
    """Python files of packages (by package and path in it) and scripts; no tests, no set-up."""
    for path in sorted([*ROOT.glob("scripts/*.py"), *ROOT.glob("evidence/**/*.py")]):
        yield path.relative_to(ROOT).as_posix(), path
    for path in sorted(SRC.glob("*/*/**/*.py")):
        inside = path.relative_to(SRC).parts[1:]
        if inside[0] not in ("test", "launch"):
            yield "/".join(inside), path


def test_rows_are_read_by_name():
    files = dict(sources())
    assert len(files) > 100
    places = [
        f"{name}:{line}: {text}"
        for name, path in files.items()
        if name not in ALGEBRA
        for line, text in numeric_subscripts(path.read_text(encoding="utf-8"))
        if text not in TEXT.get(name, ())
    ]
    assert places == [], "name these places, see heli_core/rows.py:\n" + "\n".join(places)


def test_every_exception_is_needed():
    files = dict(sources())
    for name, texts in TEXT.items():
        subscripts = {
            text for _, text in numeric_subscripts(files[name].read_text(encoding="utf-8"))
        }
        assert texts <= subscripts, name
    for name in ALGEBRA:
        assert any(numeric_subscripts(files[name].read_text(encoding="utf-8"))), name


@pytest.mark.parametrize(
    "text",
    ["y[16]", "nav[22:25]", "out[6:10]", "truth[:, 13:16]", "track.reference[:, 6]", "y[6 + i]",
     "y[i + 10]", "x[0:3]", "x[:9]", "x9[0]", "record.setpoint[:, :2]", "points[i, 3:6]",
     "x[[4, 5, 7]]", "q[4]", "A[4, 5]", "x[9:]", "nav[0]"],
)  # fmt: skip
def test_the_search_finds(text):
    assert [subscript for _, subscript in numeric_subscripts(text)] == [text]


@pytest.mark.parametrize(
    "text",
    ["nav[NAV.quat]", "v[0]", "v[2]", "A[0, 2]", "q[3]", "x[-1]", "x[1:]", "P[E_VEL + i, 0]",
     "x[X_QUAT:X_QUAT + 4]", "pos[:2]", "a.shape[0]", "x[i + 1]", "x[[1, 0, 2]]", "x[:-1]"],
)  # fmt: skip
def test_the_search_leaves_alone(text):
    assert not list(numeric_subscripts(text))


def test_the_length_of_a_tick_stands_once():
    """No file spells it again, nor what follows from it."""
    places = []
    for name, path in sources():
        if name == "heli_core/ticks.py":
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            targets = node.targets if isinstance(node, ast.Assign) else []
            spelled = any("TICK" in name_of(t).upper() for t in targets) and isinstance(
                node.value, ast.Constant
            )
            if spelled and node.value.value in (0.01, 100, 100.0, 10_000_000):
                places.append(f"{name}:{node.lineno}")
            if number(node) in (10_000_000, 1_000_000_000):
                places.append(f"{name}:{node.lineno}")
    assert places == []
