# SPDX-License-Identifier: Apache-2.0
"""The table as a picture: a state diagram in mermaid's words."""

from heli_outer_pd.modes import ON_GROUND, TABLE, Command, Phase, Transition


def diagram() -> str:
    """The transitions of the table; guards in square brackets, measured facts in round ones."""
    lines = ["stateDiagram-v2", "  [*] --> standing: on the ground", "  [*] --> hover: in the air"]
    for phase in Phase:
        lines += _from(phase)
    lines += [f"  class {', '.join(ON_GROUND)} ground", "  classDef ground fill:#eee"]
    return "\n".join(lines) + "\n"


def _from(phase: Phase) -> list[str]:
    """Lines of the transitions out of a phase, one per target."""
    words: dict[Phase, list[str]] = {}
    for row in TABLE:
        if isinstance(row, Transition) and phase in row.sources:
            guards = "".join(f" [{guard.name.lower()}]" for guard in row.guards)
            label = row.event.value if isinstance(row.event, Command) else f"({row.event.value})"
            words.setdefault(row.target, []).append(label + guards)
    return [f"  {phase} --> {target}: {', '.join(labels)}" for target, labels in words.items()]
