# SPDX-License-Identifier: Apache-2.0
"""A command with options of its own that also has sub-commands: `heli campaign SPEC`, `... report`.

The first word decides: the name of a sub-command, or else the command's own arguments.
"""

import difflib
from pathlib import Path
from typing import Any

from typer import Context
from typer.core import TyperGroup

SETTINGS: dict[str, Any] = {
    "invoke_without_command": True,
    "context_settings": {"allow_interspersed_args": True, "allow_extra_args": False},
}
"""Of the Typer: options may follow arguments, and what is left over is refused."""


class CommandWithWords(TyperGroup):
    """For `Typer(cls=..., **SETTINGS)`; its callback is the command.

    The callback takes a `typer.Context` and returns at once if its `invoked_subcommand` is one.
    """

    def parse_args(self, ctx: Context, args: list[str]) -> list[str]:  # type: ignore[override]
        """Own options and arguments, or none and a sub-command with all that follows."""
        if not args or args[0] not in self.commands:
            if not ctx.resilient_parsing:
                self._refuse_misspelt(ctx, args[:1])
            return super().parse_args(ctx, args)
        super().parse_args(ctx, [])
        ctx._protected_args, ctx.args = args[:1], args[1:]
        return ctx.args

    def get_params(self, ctx: Any) -> list[Any]:
        """Own parameters; a sub-command's usage asks, too, and has no use for the arguments."""
        known = super().get_params(ctx)
        return known if ctx.command is self else [p for p in known if p.opts[0].startswith("-")]

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Without what every group says: the sub-commands are listed below."""
        return super().collect_usage_pieces(ctx)[:-1]

    def _refuse_misspelt(self, ctx: Context, words: list[str]) -> None:
        for word in words:
            near = difflib.get_close_matches(word, self.commands, n=1)
            if near and not Path(word).exists():
                ctx.fail(f"No such command or file {word!r}. Did you mean {near[0]!r}?")


def sub_commands(context: Context, incomplete: str) -> list[str]:
    """What the shell offers for the first word; where nothing is offered, it offers files."""
    known: Any = context.command
    return [name for name in known.commands if name.startswith(incomplete)]
