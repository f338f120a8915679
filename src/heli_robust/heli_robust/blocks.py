# SPDX-License-Identifier: Apache-2.0
"""Blocks of the structured uncertainty Delta in w = Delta z, z = M w."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np


@dataclass(frozen=True)
class Block:
    """One block of Delta.

    Attributes
    ----------
    name : str
    kind : {"real", "complex", "full"}
        A real number times identity, a complex number times identity, or a full complex matrix.
    n_z, n_w : int
        Its inputs (outputs of M) and outputs (inputs of M); equal but for a full block.
    fixed : bool
        True: bounded by one, as it is. False: bounded by 1/level, which is what a bound is for.
    """

    name: str
    kind: Literal["real", "complex", "full"]
    n_z: int
    n_w: int
    fixed: bool = False


def real(name: str, times: int = 1, fixed: bool = False) -> Block:
    """A real parameter that enters `times` times."""
    return Block(name, "real", times, times, fixed)


def places(blocks: Sequence[Block]) -> list[tuple[Block, slice, slice]]:
    """Each block with its places in z and in w."""
    z = np.cumsum([0, *(block.n_z for block in blocks)])
    w = np.cumsum([0, *(block.n_w for block in blocks)])
    return [
        (block, slice(int(z[i]), int(z[i + 1])), slice(int(w[i]), int(w[i + 1])))
        for i, block in enumerate(blocks)
    ]
