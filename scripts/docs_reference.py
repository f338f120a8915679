# SPDX-License-Identifier: Apache-2.0
"""Pages that are made from the code: public names of a package, and the commands."""

import importlib
import inspect
import re
from collections.abc import Iterable, Iterator
from typing import Any

import click

FIRST = {
    "heli": (
        "fly", "load", "Flight", "design", "Design", "diff", "campaign", "Campaign", "Simulation",
        "trim", "linearize", "collective_for_thrust", "identify",
    ),
}  # fmt: skip
"""Public names that are called first, by package; the others follow in alphabetical order."""
PACKAGES_FIRST = ("heli", "heli_flight", "heli_studies", "heli_actions", "heli_inner_hinf",
                  "heli_outer_pd", "heli_observer", "heli_dynamics_sim", "heli_analysis",
                  "heli_bags")  # fmt: skip
"""Packages in the order in which their names are called: the face, flights, then the parts."""
_SECTION = re.compile(r"(?m)^([A-Z][A-Za-z ]+)\n-{3,}\n")


def in_order(packages: Iterable[str]) -> list[str]:
    """Packages in the order of `PACKAGES_FIRST`, the others after them, alphabetically."""
    place = {name: i for i, name in enumerate(PACKAGES_FIRST)}
    return sorted(packages, key=lambda name: (place.get(name, len(place)), name))


def names_page(package: str) -> str:
    """The public face of a package: signatures and docstrings of the names in `__all__`."""
    module = importlib.import_module(package)
    names = sorted(module.__all__, key=str.casefold)
    first = [name for name in FIRST.get(package, ()) if name in names]
    parts = [
        f"# {package}",
        inspect.getdoc(module) or "",
        f"What it is for, with tables and limits: [its README](../src/{package}/README.md).",
    ]
    for name in [*first, *(name for name in names if name not in first)]:
        parts += [f"## {name}", *_described(name, getattr(module, name))]
    return "\n\n".join(parts) + "\n"


def _described(name: str, found: Any) -> Iterator[str]:
    if inspect.isclass(found) or callable(found):
        kind = "class " if inspect.isclass(found) else ""
        yield f"```python\n{kind}{name}{_signature(found)}\n```"
        yield docstring(inspect.getdoc(found) or "")
        yield f"From `{found.__module__}`."
    elif inspect.ismodule(found):
        yield docstring(inspect.getdoc(found) or "")
    else:
        text = " ".join(repr(found).split())
        yield f"A `{type(found).__name__}`." if len(text) > 100 else f"`{text}`"


def _signature(found: Any) -> str:
    """A signature, one parameter a line where it is long."""
    try:
        text = str(inspect.signature(found))
    except (TypeError, ValueError):
        return ""
    # Where a default is an object of the program's memory, its address says nothing.
    text = re.sub(r" at 0x[0-9a-f]+", "", text)
    if len(text) <= 80:
        return text
    head, arrow, result = text.rpartition(") -> ")
    inner = (head if arrow else text.removesuffix(")")).removeprefix("(")
    parts = "".join(f"    {part},\n" for part in _split(inner))
    return f"(\n{parts}){' -> ' + result if arrow else ''}"


def _split(inner: str) -> Iterator[str]:
    """Parameters: what commas outside of brackets and of quotes part."""
    depth, begin, quote = 0, 0, ""
    for i, letter in enumerate(inner):
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        else:
            depth += (letter in "([{") - (letter in ")]}")
            if letter == "," and depth == 0:
                yield inner[begin:i].strip()
                begin = i + 1
    yield inner[begin:].strip()


def docstring(text: str) -> str:
    """A numpydoc docstring as Markdown: sections become bold heads, their items a list."""
    first, *sections = _SECTION.split(text)
    parts = [_escaped(first.strip())]
    for title, body in zip(sections[::2], sections[1::2], strict=True):
        lines = [_item(line) for line in body.rstrip().splitlines()]
        parts += [f"**{title}**", "\n".join(line for line in lines if line)]
    return "\n\n".join(part for part in parts if part)


def _item(line: str) -> str:
    if not line.strip():
        return ""
    if line.startswith(" "):
        return f"    {_escaped(line.strip())}"
    name, colon, kind = line.partition(" : ")
    return f"- `{name.strip()}`{': ' + _escaped(kind) if colon else ''}  "


def _escaped(text: str) -> str:
    """Text without Markdown of its own: brackets, stars and underscores are meant as they stand."""
    parts = re.split(r"(`[^`]*`)", text)
    return "".join(p if p.startswith("`") else re.sub(r"([\[\]<*_|])", r"\\\1", p) for p in parts)


def command_page() -> str:
    """Every command of `heli` with its help."""
    from typer.main import get_command

    from heli_flight.cli.app import app

    parts = [
        "# Commands",
        "Each is `./heli COMMAND`; `./hover_test.sh` is `./heli hover`. Exit codes: "
        "[heli_flight](../docs/packages/flight.md#commands).",
    ]
    for words, command in _commands((), get_command(app)):
        name = " ".join(words)
        context = click.Context(command, info_name=f"./heli {name}", terminal_width=100)
        parts += [f"## {name}", f"```text\n{command.get_help(context).strip()}\n```"]
    return "\n\n".join(parts) + "\n"


def _commands(
    words: tuple[str, ...], command: click.Command
) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    inner_of = getattr(command, "commands", {})
    # Of `heli` itself in the order of its help, those that are called first at the top.
    for name in command.list_commands(None) if not words else sorted(inner_of):
        inner = inner_of[name]
        if not inner.hidden:
            yield (*words, name), inner
            yield from _commands((*words, name), inner)
