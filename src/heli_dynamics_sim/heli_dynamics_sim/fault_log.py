# SPDX-License-Identifier: Apache-2.0
"""What is told of faults that come and go in flight. No ROS."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from heli_dynamics_sim.fault_table import Fault

FAULTS = "faults"
"""The plant's parameter."""
CLEAR_FAULTS = "clear_faults"
"""Its service: all faults end."""
_MOST = 200


def _lasting(faults: Iterable[Fault], now_s: float) -> str:
    return "; ".join(fault.words for fault in faults if fault.end_s > now_s)


@dataclass
class FaultLog:
    """The faults that were given or taken back while the aircraft flew.

    Attributes
    ----------
    lines : list of str
        In their order, a few words each; the last says so where there were more.
    """

    lines: list[str] = field(default_factory=list)

    def change(self, before: Iterable[Fault], after: Iterable[Fault], now_s: float) -> None:
        """Note what has come, and what was taken back before its end.

        Parameters
        ----------
        before, after : iterable of Fault
            Of the plant.
        now_s : float
            Flight time.
        """
        old, new = list(before), list(after)
        gone = [fault for fault in old if fault not in new and fault.end_s > now_s]
        self.lines += [f"{fault.words}, cleared at {now_s:g} s" for fault in gone]
        self.lines += [fault.words for fault in new if fault not in old]
        if len(self.lines) > _MOST:
            self.lines[_MOST - 1 :] = ["and more"]

    @staticmethod
    def cleared(faults: Iterable[Fault], now_s: float) -> str:
        """What ends when all faults do at a flight time, in a sentence."""
        ended = _lasting(faults, now_s)
        return f"cleared: {ended}" if ended else "there was no fault"

    def facts(self, faults: Iterable[Fault], now_s: float) -> dict[str, str]:
        """For /diagnostics: the faults that act or are to come, and those given in flight."""
        said = {
            "faults": _lasting(faults, now_s),
            "faults_in_flight": "; ".join(self.lines),
        }
        return {name: words for name, words in said.items() if words}
