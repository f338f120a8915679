# SPDX-License-Identifier: Apache-2.0
"""What readers raise on damaged bytes, as one sentence. No rclpy.

The readers of `rosbags` and `mcap` trust a bag's bytes: on damaged ones they raise whatever the
line at hand raises. So everything that they raise is taken for damage, and nothing of ours is.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TypeVar

from heli_bags.folder import BagError, reason

_Item = TypeVar("_Item")
_END = object()
_NEEDS_WORDS = (
    LookupError, AttributeError, TypeError, AssertionError, ArithmeticError, MemoryError,
    RecursionError,
)  # fmt: skip


def damage(path: Path, error: Exception) -> BagError:
    """The error for the user: one line that names the bag."""
    if isinstance(error, BagError):
        return error
    why = reason(error)
    if isinstance(error, _NEEDS_WORDS) and type(error).__module__ == "builtins":
        # Their texts are for programmers: a name, or nothing.
        kind = type(error).__name__
        why = f"it is damaged ({kind if why == kind else f'{kind}: {why}'})"
    return BagError(f"{path}: not a readable bag: {why}")


def guarded(path: Path, items: Iterable[_Item]) -> Iterator[_Item]:
    """The items of a library's iterator, whose every complaint is a BagError.

    Parameters
    ----------
    path : Path
        The bag, for the sentence.
    items : iterable
        What the library yields.
    """
    try:
        iterator = iter(items)
    except Exception as error:
        raise damage(path, error) from error
    while True:
        try:
            item = next(iterator, _END)
        except Exception as error:
            raise damage(path, error) from error
        if item is _END:
            return
        yield item  # type: ignore[misc]
