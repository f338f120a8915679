# SPDX-License-Identifier: Apache-2.0
"""What the first flight in one process on a machine waits for, said before it waits.

Set-up compiles what the nodes fly; the loop of one process is compiled by whom flies it first.
"""

from typing import Any

from rich.console import Console

from heli_math.jit import is_compiled

COMPILES = (
    "heli: compiles the loop for this machine: once, half a minute to a minute; from then on a "
    "flight of 60 s takes about a second"
)


def tell_if_it_compiles(say: Console, own_laws: bool = False) -> None:
    """Say so if a flight in this process would compile the loop.

    Parameters
    ----------
    say : Console
    own_laws : bool
        Whether laws in Python fly: they need only the kernels of the nodes.
    """
    from heli_dynamics_sim import plant
    from heli_flight.loop.closed_loop import fly

    kernel: Any = plant.advance if own_laws else fly
    if not getattr(kernel, "signatures", True) and not is_compiled(kernel):
        say.print(COMPILES, highlight=False, soft_wrap=True, markup=False)
