# SPDX-License-Identifier: Apache-2.0
"""What the scripts of results that fly many seeds share: their options, and how they print."""

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from heli_core.rcl_yaml import ParameterError
from heli_studies.campaign.run import parse_seeds


def parser_with_seeds(doc: str | None, seeds: str = "1..20") -> argparse.ArgumentParser:
    """A parser with `--seeds`, a list of numbers; what is none is refused in a sentence, code 2."""
    parser = argparse.ArgumentParser(description=(doc or "").splitlines()[0])
    parser.add_argument("--seeds", type=_seeds, default=seeds, help="1..20, 7 or 1,5,9")
    return parser


def print_tables(
    doc: str | None,
    found_on: Callable[[Sequence[int]], Mapping[str, Any]],
    tables: Callable[[Mapping[str, Any]], str],
) -> None:
    """Read `--seeds` and `--json`; print what is found on these seeds as Markdown or JSON."""
    parser = parser_with_seeds(doc)
    parser.add_argument("--json", action="store_true", help="print JSON instead of Markdown")
    given = parser.parse_args()
    found = found_on(given.seeds)
    print(json.dumps(found) if given.json else tables(found))


def _seeds(text: str) -> list[int]:
    try:
        return parse_seeds(text)
    except ParameterError as exc:
        raise argparse.ArgumentTypeError(str(exc).removeprefix("--seeds ")) from exc
