# SPDX-License-Identifier: Apache-2.0
"""The commands of `heli` in sections: what its help shows, and in which order."""

from collections.abc import Iterator
from typing import Any

from typer import Context
from typer.core import TyperGroup

SECTIONS: dict[str, tuple[str, ...]] = {
    "Fly, and read what was flown": (
        "hover", "report", "replay", "diff", "score", "bag", "list", "new",
    ),
    "Design, identify, fly many": (
        "design", "tune", "robust", "identify", "log", "compare", "campaign",
    ),
    "Command a flight that runs (hover --realtime)": (
        "takeoff", "goto", "land", "mode", "joy", "fault", "topics", "echo",
    ),
    "Fly with other programs": ("ardupilot", "px4", "mavlink"),
    "Environment": ("setup", "python", "run"),
    "For maintainers": ("results",),
}  # fmt: skip
"""Title to commands, most used first. Extras that are not installed are left out."""
OTHER = "Other"


def in_sections(names: set[str]) -> Iterator[tuple[str, list[str]]]:
    """Title and commands of each section that has any; what the table does not name comes last."""
    for title, listed in SECTIONS.items():
        if found := [name for name in listed if name in names]:
            yield title, found
    if rest := sorted(names.difference(*SECTIONS.values())):
        yield OTHER, rest


class Sectioned(TyperGroup):
    """For `Typer(cls=...)`: a group whose help shows its commands in sections."""

    def list_commands(self, ctx: Context) -> list[str]:  # type: ignore[override]
        """Names in the order of the sections; completion offers them so, too."""
        return [name for _, names in in_sections(set(self.commands)) for name in names]

    def format_commands(self, ctx: Context, formatter: Any) -> None:  # type: ignore[override]
        """A list of commands under each title."""
        shown = {name: found for name, found in self.commands.items() if not found.hidden}
        width = formatter.width - 6 - max(map(len, shown))
        for title, names in in_sections(set(shown)):
            with formatter.section(title):
                formatter.write_dl([(n, shown[n].get_short_help_str(width)) for n in names])
