# SPDX-License-Identifier: Apache-2.0
"""Damaged and hostile input, case by case: taken, or refused in one sentence; nothing else.

2000 cases of every stream of messages and 10 000 of other cheap ones, fewer of whole commands and
files that are resolved; HELI_FUZZ_CASES=10000 is so many of each, which
evidence/experiments/fuzz.py counts.
"""

import os

import pytest

from support import fuzz_files, fuzz_messages
from support.fuzz_parsers import PARSERS
from support.fuzzing import damaged_bytes, is_sentence, numbers_of, tally

CASES = int(os.environ.get("HELI_FUZZ_CASES", "0"))
TARGETS = {target.name: target for target in (*fuzz_messages.TARGETS, *fuzz_files.TARGETS)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzz")


@pytest.mark.slow
@pytest.mark.parametrize("name", TARGETS)
def test_what_is_damaged_is_taken_or_refused_in_a_sentence(name, folder):
    target = TARGETS[name]
    cases = CASES or target.short
    counts = tally(target, range(cases), folder)
    assert counts.failed == 0, counts.failures
    assert counts.taken + counts.refused == cases
    # The damage is one: of enough cases some are refused.
    assert counts.refused or cases < 20, name


@pytest.mark.parametrize("name", PARSERS)
def test_what_a_guided_fuzz_begins_with_is_good_and_what_is_damaged_does_no_harm(name, folder):
    """As `scripts/fuzz_atheris.py` calls them."""
    parser = PARSERS[name]
    seeds = parser.seeds()
    assert seeds and [parser.attempt(seed, folder) for seed in seeds] == [""] * len(seeds)
    for number in range(200):
        numbers = numbers_of(next(iter(TARGETS.values())), number)
        parser.attempt(damaged_bytes(numbers, numbers.choice(seeds)), folder)
    assert is_sentence(parser.attempt(b"", folder))


def test_a_case_is_the_same_each_time():
    target = next(iter(TARGETS.values()))
    one, again, other = (damaged_bytes(numbers_of(target, n), bytes(64)) for n in (7, 7, 8))
    assert one == again != other


@pytest.mark.parametrize(
    ("text", "good"),
    [("gps/fix: no fix", True), ("", False), ("two\nlines", False), ("\x1b[2J", False)],
)
def test_what_counts_as_a_sentence(text, good):
    assert is_sentence(text) == good
