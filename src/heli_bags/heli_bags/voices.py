# SPDX-License-Identifier: Apache-2.0
"""Who speaks in /diagnostics under the names of an aircraft's nodes without being one. No ROS.

Jazzy's rclpy does not say who sent a message, but which one of its sender's it is. A node reports
by one publisher, so the numbers of what is said under its name go on by one.
"""

from collections import Counter
from collections.abc import Iterable, Sequence


class Voices:
    """What is said under the names of one aircraft's nodes, and who else may say it.

    Parameters
    ----------
    namespace : str
        Of the aircraft.
    own : iterable of str
        Names of its nodes.

    Attributes
    ----------
    foreign : set of str
        Names under which a message has come whose number was not the next one.
    """

    def __init__(self, namespace: str, own: Iterable[str]) -> None:
        self._space = namespace.strip("/")
        self._heard = {f"{self._space}/{name}".strip("/") for name in own}
        self._numbers: dict[str, int] = {}
        self._times: dict[str, int] = {}
        self._anew: set[str] = set()
        self.foreign: set[str] = set()

    def hear(self, names: Sequence[str], number: int) -> bool:
        """Take the names that a message speaks of; False if it is not the next one of ours.

        Parameters
        ----------
        names : sequence of str
            Full names of its statuses.
        number : int
            Which one of its sender's it is.
        """
        fits = True
        for full in names:
            name = full.strip("/")
            # Others than our nodes may report as "name: what".
            self._heard.add(name.split(":")[0])
            if name.rpartition("/")[0] != self._space:
                continue
            if self._numbers.setdefault(name, number - 1) + 1 == number:
                self._numbers[name] = number
            elif name in self._anew:
                self._anew.discard(name)
                self._numbers[name] = number
            else:
                self.foreign.add(name)
                fits = False
        return fits

    def forget(self, name: str, times: int) -> None:
        """A node of ours was started again, so many times by now: its number begins anew, once.

        The last words of its predecessor may still come before.
        """
        if times > self._times.get(name, 0):
            self._times[name] = times
            self._anew.add(f"{self._space}/{name}".strip("/"))

    def strangers(self, senders: Iterable[tuple[str, str]]) -> list[str]:
        """Of the senders of /diagnostics, those that may have said it.

        Who reports under a name of its own is none, unless two have the same.

        Parameters
        ----------
        senders : iterable of (str, str)
            Namespace and name of each.
        """
        counts = Counter(f"{space.strip('/')}/{name}".strip("/") for space, name in senders)
        return [f"/{n}" for n, count in sorted(counts.items()) if n not in self._heard or count > 1]
