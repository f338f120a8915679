# SPDX-License-Identifier: Apache-2.0
"""A text out of a file or a message, fit for a sentence."""

LONGEST = 200
"""Characters: what is damaged or hostile may hold a text of any length."""


def printable(text: str, longest: int = LONGEST) -> str:
    """The beginning of a text, without what would end the line or steer a terminal."""
    if len(text) <= longest and text.isprintable():
        return text
    short = text if len(text) <= longest else f"{text[:longest]}..."
    return "".join(c if c.isprintable() else repr(c).strip("'") for c in short)
