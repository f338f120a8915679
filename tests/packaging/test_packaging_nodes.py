# SPDX-License-Identifier: Apache-2.0
"""The life of a node stays plain: attributes are born in `__init__`, hooks have public names."""

import ast
import importlib
import inspect
import textwrap
from pathlib import Path

import pytest

from heli_msgs_bridge.lifecycle_node import ManagedNode, TableNode
from heli_msgs_bridge.tick_node import TickNode

SRC = Path(__file__).resolve().parents[2] / "src"
MODULES = sorted(f"{path.parent.name}.node" for path in SRC.glob("*/heli*/node.py"))
MODULES += [
    f"heli_flight.graph.{name}_node" for name in ("scenario", "world_clock", "lifecycle_manager")
]


def nodes():
    """Classes of all nodes and their bases."""
    classes = {TableNode, ManagedNode, TickNode}
    for module in MODULES:
        content = vars(importlib.import_module(module)).values()
        classes |= {c for c in content if inspect.isclass(c) and issubclass(c, ManagedNode)}
    return sorted(classes, key=lambda c: c.__name__)


def ours(cls):
    return [c for c in cls.__mro__ if c.__module__.startswith("heli_")]


def assigned(cls, born):
    """Attributes of `self` that are assigned in `__init__` (born) or in the other methods."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(cls)))
    attributes = set()
    for method in tree.body[0].body:
        if isinstance(method, ast.FunctionDef) and (method.name == "__init__") == born:
            attributes |= {
                node.attr
                for node in ast.walk(method)
                if isinstance(node, ast.Attribute)
                and isinstance(node.ctx, ast.Store)
                and isinstance(node.value, ast.Name)
                and node.value.id == "self"
            }
    return attributes


@pytest.mark.parametrize("cls", nodes(), ids=lambda c: c.__name__)
def test_attributes_are_born_in_init(cls):
    """What a stage makes is data of that stage (`core`, `run`), not a new attribute of the node."""
    born = set().union(*(assigned(c, True) for c in ours(cls)))
    assert assigned(cls, False) - born == set()
    assert "getattr(self" not in inspect.getsource(cls)


@pytest.mark.parametrize("cls", nodes(), ids=lambda c: c.__name__)
def test_nobody_overrides_a_private_hook(cls):
    def private(c):
        return {n for n in vars(c) if n.startswith("_") and not n.startswith(("__", "_abc"))}

    above = set().union(set(), *(private(base) for base in ours(cls)[1:]))
    assert private(cls) & above == set()


def test_all_nodes_are_looked_at():
    assert len(nodes()) == len(MODULES) + 3  # the bases
