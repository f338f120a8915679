# SPDX-License-Identifier: Apache-2.0
"""What the scripts of results that fly many seeds share: the option `--seeds`."""

import argparse

from heli_core.rcl_yaml import ParameterError
from heli_studies.campaign.run import parse_seeds


def parser_with_seeds(doc: str | None, seeds: str = "1..20") -> argparse.ArgumentParser:
    """A parser with `--seeds`, a list of numbers; what is none is refused in a sentence, code 2."""
    parser = argparse.ArgumentParser(description=(doc or "").splitlines()[0])
    parser.add_argument("--seeds", type=_seeds, default=seeds, help="1..20, 7 or 1,5,9")
    return parser


def _seeds(text: str) -> list[int]:
    try:
        return parse_seeds(text)
    except ParameterError as exc:
        raise argparse.ArgumentTypeError(str(exc).removeprefix("--seeds ")) from exc
