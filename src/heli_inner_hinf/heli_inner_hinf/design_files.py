# SPDX-License-Identifier: Apache-2.0
"""Writes model and trim numbers into an inner-loop YAML and leaves the rest of it, comments too,
alone."""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from heli_inner_hinf.weights import checked

_SHAPES = {"A": (9, 9), "B": (9, 3), "E": (9, 3), "x": (9,), "u": (4,)}


def flow_array(value: ArrayLike, indent: int, digits: int = 10) -> str:
    """YAML flow sequence of doubles, one matrix row per line; every number reads back as a
    double."""
    rows = np.atleast_2d(np.asarray(value, float))
    texts = [", ".join(_double(v, digits) for v in row) for row in rows]
    return "[" + (",\n" + " " * indent).join(texts) + "]"


def write_model_yaml(
    path: str | Path,
    A: ArrayLike,
    B: ArrayLike,
    E: ArrayLike,
    x_trim: ArrayLike,
    u_trim: ArrayLike,
    extra: Mapping[str, ArrayLike] | None = None,
) -> None:
    """Replace model.A, model.B, model.E, trim.x, trim.u in the inner-loop YAML at `path`.

    Parameters
    ----------
    path : path
        A file like the packaged config/inner_loop.yaml, with these keys as flow sequences.
    A, B, E : (9, 9), (9, 3), (9, 3) arrays
        Linear model about trim, eq. (9).
    x_trim, u_trim : (9,), (4,) arrays
        Trim of the nine states, and of d_lat, d_lon, d_ped, d_col.
    extra : mapping, optional
        Further keys that are unique in the file (K_P, K_I, K_D, C11, ...) to arrays.

    Raises
    ------
    ShapeError
        A matrix has the wrong shape; names it.
    KeyError
        The file lacks one of the keys, or has it twice.
    """
    values = {"A": A, "B": B, "E": E, "x": x_trim, "u": u_trim}
    arrays = {key: checked(key, value, _SHAPES[key]) for key, value in values.items()}
    arrays.update({key: np.asarray(value, float) for key, value in (extra or {}).items()})
    text = Path(path).read_text(encoding="utf-8")
    for key, array in arrays.items():
        text = _replace(text, key, array, str(path))
    Path(path).write_text(text, encoding="utf-8")


def _replace(text: str, key: str, array: np.ndarray, path: str) -> str:
    pattern = re.compile(rf"^([ ]+){re.escape(key)}:\s*\[[^\]]*\]", re.MULTILINE)
    found = pattern.findall(text)
    if len(found) != 1:
        raise KeyError(f"{path} holds the key {key} {len(found)} times instead of once")

    def line(match: re.Match[str]) -> str:
        indent = match.group(1)
        return f"{indent}{key}: " + flow_array(array, len(indent) + len(key) + 3)

    return pattern.sub(line, text)


def _double(value: float, digits: int) -> str:
    text = f"{value + 0.0:.{digits}g}"
    if "e" in text:
        mantissa, exponent = text.split("e")
        return f"{mantissa if '.' in mantissa else mantissa + '.0'}e{exponent}"
    return text if "." in text else text + ".0"
