# SPDX-License-Identifier: Apache-2.0
"""Damaged input, case by case: what is damaged follows from target and number alone."""

import random
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

Attempt = Callable[[random.Random, Path], str]
"""One case, with a folder to write to: the sentence of the refusal, empty if the input was taken.

Raises what the product raises beyond what it may; AssertionError for an output that may not be.
"""
NASTY = (
    0.0, -0.0, 1.0, -1.0, 1.0000001, -1.5, 5e-324, 1e-310, 1e-9, 1e6, 1e18, -1e150, 1e300,
    1.7976931348623157e308, float("inf"), float("-inf"), float("nan"),
)  # fmt: skip
NASTY_INTS = (0, 1, -1, 127, 128, 255, 2**15, 2**31 - 1, -(2**31), 2**32 - 1, 2**63 - 1, -(2**63))
MANY = 10_000
"""Cases of a target that is cheap, and of every one in the long form."""
_MOST_CHARACTERS = 8000
_KEPT, _SHOWN, _BEGINNING = 5, 300, 60


@dataclass(frozen=True)
class Target:
    """Something that reads what others wrote.

    Attributes
    ----------
    name : str
        Kind and name, such as `message odom`.
    attempt : callable
    short : int
        Cases of it in the short form, that of every test run: fewer where one takes milliseconds.
    """

    name: str
    attempt: Attempt
    short: int = MANY


@dataclass
class Tally:
    """What became of a target's cases.

    Attributes
    ----------
    cases, taken, refused : int
    failed : int
        A traceback, a bad output, or a refusal that is not one sentence.
    failures : list of str
        The first of them: number, and what happened.
    sentences : set of str
        Beginnings of refusals, without the folder: not always the same one.
    """

    cases: int = 0
    taken: int = 0
    refused: int = 0
    failed: int = 0
    failures: list[str] = field(default_factory=list)
    sentences: set[str] = field(default_factory=set)


def numbers_of(target: Target, number: int) -> random.Random:
    """The random numbers of a case."""
    return random.Random(f"{target.name} {number}")


def is_sentence(text: str) -> bool:
    """Whether a refusal is one line of bounded length, without what steers a terminal."""
    return bool(text.strip()) and len(text) <= _MOST_CHARACTERS and text.isprintable()


def tally(target: Target, numbers: Iterable[int], folder: Path) -> Tally:
    """Try the cases of these numbers."""
    counts = Tally()
    for number in numbers:
        counts.cases += 1
        try:
            sentence = target.attempt(numbers_of(target, number), folder)
        except (Exception, SystemExit) as error:
            _fail(counts, number, f"{type(error).__name__}: {str(error)[:_SHOWN]}")
            continue
        if not sentence:
            counts.taken += 1
        elif is_sentence(sentence):
            counts.refused += 1
            counts.sentences.add(sentence.replace(str(folder), "")[:_BEGINNING])
        else:
            _fail(
                counts, number, f"no sentence: {sentence[:_SHOWN]!r} ({len(sentence)} characters)"
            )
    return counts


def _fail(counts: Tally, number: int, what: str) -> None:
    counts.failed += 1
    if len(counts.failures) < _KEPT:
        counts.failures.append(f"case {number}: {what}")


def damaged_bytes(numbers: random.Random, raw: bytes) -> bytes:
    """Bytes changed, cut off, zeroed, repeated, moved or put in."""
    changed = bytearray(raw)
    for _ in range(numbers.randint(1, 4)):
        at, size = numbers.randrange(len(changed) + 1), numbers.choice((1, 2, 4, 8, 64, 512))
        kind = numbers.randrange(7)
        if kind == 0:
            changed[at : at + size] = numbers.randbytes(len(changed[at : at + size]))
        elif kind == 1:
            changed[at : at + 1] = bytes([numbers.choice((0, 1, 127, 128, 255))])
        elif kind == 2:
            del changed[at:]
        elif kind == 3:
            del changed[at : at + size]
        elif kind == 4:
            changed[at : at + size] = bytes(len(changed[at : at + size]))
        elif kind == 5:
            changed[at:at] = changed[at : at + size]
        else:
            value = numbers.choice(NASTY_INTS) % 2**64
            width = numbers.choice((4, 8))
            changed[at : at + width] = (value % 2 ** (8 * width)).to_bytes(width, "little")
    return bytes(changed)


_WORDS = (
    "", "~", "null", "true", "no", "0", "-1", "1", "1.0", "1e999", ".nan", "-.inf", "1e-320",
    "9" * 30, "9" * 5000, "0x" + "f" * 300, "1:99:99", "2001-99-99", "[]", "{}", "[1, a]",
    "[[1.0]]", "[" * 400, "{a: " * 400, "&a [*a]", "*a", "<<", "!!python/object:os.system x",
    "!!binary x", "'", '"', "|", "? a", "- b", "\t", "\x00", "\x1b[31m", "é", "\u2028", "a" * 3000,
    "/**", "ros__parameters", "none", "each", "1_000", "../../etc/passwd", "%d", "[nan, nan, nan]",
    "[1.0, 2.0]", "{uniform: [0, 1000000000000]}", "{choice: [1, a, [2]]}", "{normal: [0.0, 0.0]}",
)  # fmt: skip


def damaged_text(numbers: random.Random, text: str) -> str:
    """A YAML text with a value, key, line or some characters replaced, moved or left out."""
    lines = text.splitlines()
    for _ in range(numbers.randint(1, 3)):
        at = numbers.randrange(len(lines) + 1)
        here = lines[at : at + 1] or [""]
        key, colon, _ = here[0].partition(":")
        kind = numbers.randrange(8)
        if kind <= 2:
            lines[at : at + 1] = [f"{key}{colon} {numbers.choice(_WORDS)}"]
        elif kind == 3:
            indent = here[0][: len(here[0]) - len(here[0].lstrip())]
            lines[at : at + 1] = [f"{indent}{numbers.choice(_WORDS)}: 1.0", *here]
        elif kind == 4:
            lines[at : at + 1] = []
        elif kind == 5:
            lines[at:at] = here
        elif kind == 6:
            lines[at : at + 1] = [" " * numbers.randint(0, 9) + here[0].lstrip()]
        else:
            raw = damaged_bytes(numbers, here[0].encode() or b" ")
            lines[at : at + 1] = [raw.decode("latin-1")]
    return "\n".join(lines)
