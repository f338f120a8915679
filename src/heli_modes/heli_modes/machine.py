# SPDX-License-Identifier: Apache-2.0
"""What the table says of an event: the next phase, or a refusal in words."""

import difflib
from collections.abc import Collection
from dataclasses import dataclass

from heli_modes.table import TABLE, Command, Fact, Guard, Phase, Refused, Transition


@dataclass(frozen=True)
class Refusal:
    """A command that is not followed; nothing has changed.

    Attributes
    ----------
    asked, reason : str
        What was asked, and why it is not done.
    allowed : tuple of str
        What would be.
    """

    asked: str
    reason: str
    allowed: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """One line for people."""
        return f"{self.asked}: {self.reason}; allowed: {', '.join(self.allowed)}"


def _row(phase: Phase, event: Command | Fact) -> Transition | Refused | None:
    return next((row for row in TABLE if row.event == event and phase in row.sources), None)


def allowed(phase: Phase) -> tuple[str, ...]:
    """Names of the commands that have a way out of a phase, whether or not its guards hold."""
    return tuple(c.value for c in Command if isinstance(_row(phase, c), Transition))


def decide(
    phase: Phase, event: Command | Fact, fails: Collection[Guard] = ()
) -> Phase | Refusal | None:
    """The phase that follows; it is for the caller to enter it.

    Parameters
    ----------
    phase : Phase
        The present one.
    event : Command or Fact
    fails : collection of Guard
        Guards that do not hold now.

    Returns
    -------
    Phase or Refusal or None
        A fact is never refused: where it means nothing it is None, the phase stays.
    """
    row = _row(phase, event)
    if isinstance(row, Transition):
        failed = next((guard for guard in row.guards if guard in fails), None)
        if failed is None:
            return row.target
        return Refusal(event.value, f"not in {phase.mode} now: {failed.value}", _others(row, phase))
    if row is None:
        return None
    return Refusal(row.event.value, row.reason, allowed(phase))


def _others(row: Transition, phase: Phase) -> tuple[str, ...]:
    """What else may be asked; the same again if that is all."""
    others = tuple(name for name in allowed(phase) if name != row.event.value)
    return others or (f"{row.event.value} once it is otherwise",)


def command_named(name: str) -> Command | Refusal:
    """The command of a name, its own or that of its mode; an unknown one with a suggestion."""
    known = {word: command for command in Command for word in command.names}
    if name in known:
        return known[name]
    near = difflib.get_close_matches(name, known, n=1)
    hint = f"; did you mean {near[0]}?" if near else ""
    return Refusal(f"mode {name!r}", f"no such mode{hint}", tuple(known))
