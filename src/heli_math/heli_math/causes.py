# SPDX-License-Identifier: Apache-2.0
"""Refusals with a named cause: the base of the packages' errors."""

from enum import Enum


class CausedError(ValueError):
    """Something that is refused.

    Attributes
    ----------
    cause : Enum
        For programs; the message is one sentence for people and names what is wrong and its number.
    """

    def __init__(self, cause: Enum, sentence: str) -> None:
        super().__init__(sentence)
        self.cause = cause
