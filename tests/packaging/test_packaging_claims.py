# SPDX-License-Identifier: Apache-2.0
"""What README, tutorial and CONTRIBUTING say of graph, kernels and gamma, against the code."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest

from heli_flight.settings import resolve
from heli_inner_hinf.design import AttitudeConfig
from heli_msgs_bridge import topics

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
TUTORIAL = (ROOT / "docs/tutorial.md").read_text(encoding="utf-8")
MODULES = sorted((ROOT / "src").glob("*/heli*/**/*.py"))
EDGES = [
    (source, words.split(", "), sink)
    for source, words, sink in re.findall(
        r"(?m)^  (\w+) -- (.*?) --> (\w+)$", README.split("## The graph")[1].split("```")[1]
    )
]


def belongs(topic, word):
    """Whether a word of the picture stands for a topic: it is a part of its name."""
    return word in topic.name.split("/")


@pytest.mark.parametrize("topic", topics.TABLE, ids=lambda topic: topic.name)
def test_the_picture_has_an_arrow_for_each_link_of_the_graph(topic):
    for source in topic.source:
        for sink in topic.sinks:
            drawn = [words for a, words, b in EDGES if (a, b) == (source, sink)]
            assert any(belongs(topic, word) for words in drawn for word in words), (source, sink)


def test_every_arrow_of_the_picture_is_a_link():
    assert len(EDGES) >= 9
    for source, words, sink in EDGES:
        for word in words:
            if word == "all topics":  # the live view's, which no node waits for
                continue
            sent = [t for t in topics.TABLE if belongs(t, word) and source in t.source]
            assert sent, (source, word)
            assert sink == "recorder" or any(sink in topic.sinks for topic in sent), (word, sink)


def kernels(path):
    """Functions of a module that are compiled."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef):
            decorators = [ast.unparse(decorator) for decorator in node.decorator_list]
            if any(re.match(r"(\w+\.)?n?jit(_inlined)?\b", d) for d in decorators):
                yield node, decorators


def test_kernels_are_compiled_by_the_one_decorator_and_draw_no_random_numbers():
    count = 0
    for path in MODULES:
        for node, decorators in kernels(path):
            count += 1
            where = f"{path.name}: {node.name}"
            assert {"njit", "njit_inlined"} & set(decorators), where
            code = ast.unparse(node.body[ast.get_docstring(node) is not None :])
            assert not re.search(r"\brandom\b|\brng\b|default_rng", code), where
        if path.name != "jit.py":
            text = path.read_text(encoding="utf-8")
            assert not re.search(r"(?m)^\s*from numba import.*\bn?jit\b", text), path
    assert count > 100


def test_gamma_closer_to_its_bound_lets_less_of_the_worst_wind_through():
    """The tutorial's example: largest gains over frequency, wind to attitude and to actuators."""
    (example,) = re.findall(r"gamma: ([\d.]+) +# closer to gamma\*", TUTORIAL)
    gains = []
    for changes in ({}, {"gamma": float(example)}):
        values = resolve(controller="hinf", overrides={"inner_loop": changes}).nodes["inner_loop"]
        kernel = AttitudeConfig.from_parameters(values).params
        A, B, E = (
            np.array(values[f"model.{name}"]).reshape(9, columns)
            for name, columns in (("A", 9), ("B", 3), ("E", 3))
        )
        closed = A + B @ kernel.F
        states = [
            np.linalg.solve(1j * frequency * np.eye(9) - closed, E)
            for frequency in np.geomspace(0.01, 300.0, 400)
        ]
        outputs = (np.eye(9)[:2], np.eye(9)[2:4], kernel.F)
        gains.append([max(np.linalg.norm(C @ x, 2) for x in states) for C in outputs])
    (angles, rates, actuators), (angles_closer, rates_closer, actuators_closer) = gains
    assert angles_closer < 0.99 * angles and rates_closer < 0.99 * rates
    assert actuators_closer > 1.05 * actuators


def test_every_attack_that_is_held_names_a_test_that_there_is():
    text = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`(test_\w+)`", text))
    files = [*(ROOT / "tests").rglob("test_*.py"), *(ROOT / "src").glob("*/test/test_*.py")]
    known = {name for file in files for name in re.findall(r"def (test_\w+)", file.read_text())}
    assert len(named) >= 12 and named <= known, named - known
    modules = set(re.findall(r"`(test_\w+\.py)`", text))
    assert modules <= {file.name for file in files}
