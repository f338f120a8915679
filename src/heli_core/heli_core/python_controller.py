# SPDX-License-Identifier: Apache-2.0
"""A controller that somebody gives in Python: found by its name, and checked at every step.

A controller is a function `step(x, r, t)`, or a class with `step(self, x, r, t)` and, if it
remembers something, `reset(self)` or `reset(self, x, r, u)`, called before its first step and
whenever it begins again. Its attribute `loop` says in whose place it flies: `inner` (default) or
`outer`. What x, r and the result are is said by the loop that flies it
(`heli_inner_hinf.ground_and_manual`, `heli_outer_pd.python_controller`). It gets copies and cannot
harm the loop; whatever it does wrong is a sentence.
"""

import importlib
import importlib.util
import inspect
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_core.rcl_yaml import ParameterError

INNER, OUTER = "inner", "outer"
LOOPS = (INNER, OUTER)
OUTPUTS = {INNER: ("d_lat", "d_lon", "d_ped"), OUTER: ("phi", "theta", "psi", "collective")}
"""What a controller of each loop gives, in this order."""
PARAMETER = "own_law"
"""Name of the parameter of the nodes inner_loop and outer_loop that names one."""
GIVEN = "python"
"""Stands for the module of a controller that is in no file."""
_FORM = "write MODULE:NAME or FILE.py:NAME"


class LawError(ParameterError):
    """A controller cannot be flown: it is not found, or is none; one sentence."""


class PythonLaw:
    """A controller given in Python.

    Parameters
    ----------
    controller : callable or object
        A function, a class (made without arguments), or an object with `step`.
    name : str, optional
        For people; default: its own.
    source : str
        How a node finds it again (`find`); empty for one that is in no file.

    Attributes
    ----------
    loop : str
        One of `LOOPS`.
    failure : str
        What it has done wrong in flight, one sentence; it is not asked again. Empty: nothing.

    Raises
    ------
    LawError
    """

    def __init__(self, controller: Any, name: str = "", source: str = "") -> None:
        self.name = name or _name_of(controller)
        self.source, self.failure = source, ""
        self.loop = getattr(controller, "loop", INNER)
        if self.loop not in LOOPS:
            raise LawError(
                f"controller {self.name}: loop = {self.loop!r} is not allowed; "
                f"allowed: {', '.join(LOOPS)}"
            )
        made = self._made(controller) if inspect.isclass(controller) else controller
        self._step: Callable[..., Any] = getattr(made, "step", made)
        self._reset: Callable[..., Any] | None = getattr(made, "reset", None)
        if not callable(self._step):
            raise LawError(
                f"controller {self.name}: is a {type(controller).__name__}; allowed: a function "
                "(x, r, t), or a class with step(self, x, r, t)"
            )
        self._outputs = OUTPUTS[self.loop]
        if not _takes(self._step, 3):
            raise LawError(
                f"controller {self.name}: step{_signature(self._step)} must take x, r, t: states, "
                "command, time (s)"
            )
        self._of_reset = 0
        if self._reset is not None:
            self._of_reset = 3 if _takes(self._reset, 3) else 0
            if not self._of_reset and not _takes(self._reset, 0):
                raise LawError(
                    f"controller {self.name}: reset{_signature(self._reset)} must take nothing, or "
                    "x, r, u: states, command, what is flown"
                )

    def _made(self, cls: type) -> Any:
        try:
            return cls()
        except Exception as error:
            raise LawError(
                f"controller {self.name}: cannot be made: {in_one_line(error)}"
            ) from error

    def reset(self, x: NDArray, r: NDArray, u: NDArray, tick: int, time_s: float) -> None:
        """Have it begin: now, and with what is flown until now."""
        if self._reset is None or self.failure:
            return
        arguments = (x.copy(), r.copy(), u.copy())[: self._of_reset]
        try:
            self._reset(*arguments)
        except (Exception, SystemExit) as error:
            self._fail("reset", f"raised {in_one_line(error)}", tick, time_s)

    def step(self, x: NDArray, r: NDArray, tick: int, time_s: float) -> NDArray | None:
        """What it gives, (3,) or (4,), finite; None where it has failed, now or before.

        Parameters
        ----------
        x, r : arrays
        tick : int
            Of the flight, for the sentence.
        time_s : float
            Flight time.
        """
        if self.failure:
            return None
        try:
            made = self._step(x.copy(), r.copy(), time_s)
        except (Exception, SystemExit) as error:
            self._fail("step", f"raised {in_one_line(error)}", tick, time_s)
            return None
        names = self._outputs
        try:
            values = np.array(made, dtype=np.float64).ravel()
        except (TypeError, ValueError):
            self._fail("step", f"gave a {type(made).__name__}", tick, time_s)
            return None
        if values.size != len(names):
            self._fail("step", f"gave {values.size} numbers", tick, time_s)
            return None
        for name, value in zip(names, values, strict=True):
            if not np.isfinite(value):
                self._fail("step", f"gave {value} for {name}", tick, time_s)
                return None
        return values

    def _fail(self, what: str, why: str, tick: int, time_s: float) -> None:
        allowed = "" if why.startswith("raised") else f"; allowed: {_count(self._outputs)}"
        self.failure = (
            f"The {self.loop} controller {self.name} failed at tick {tick} ({time_s:.2f} s): "
            f"{what} {why}{allowed}"
        )


def _count(names: Sequence[str]) -> str:
    return f"{len(names)} finite numbers, {', '.join(names)}"


def _name_of(controller: Any) -> str:
    return str(getattr(controller, "__qualname__", None) or getattr(controller, "__name__", None)
               or type(controller).__name__)  # fmt: skip


def _signature(function: Callable[..., Any]) -> str:
    try:
        return str(inspect.signature(function))
    except (TypeError, ValueError):
        return ""


def _takes(function: Callable[..., Any], count: int) -> bool:
    """Whether a function can be called with so many arguments; True where it does not say."""
    try:
        inspect.signature(function).bind(*range(count))
    except TypeError:
        return False
    except ValueError:
        return True
    return True


def in_one_line(error: BaseException) -> str:
    """An exception in one line, with the place where it was raised."""
    words = " ".join(str(error).split())
    line = f"{type(error).__name__}: {words}" if words else type(error).__name__
    if isinstance(error, SyntaxError):
        return line
    places = traceback.extract_tb(error.__traceback__)
    return f"{line} ({Path(places[-1].filename).name}:{places[-1].lineno})" if places else line


def full_source(text: str) -> str:
    """A controller's name as any process finds it: a file's path is made absolute.

    Raises
    ------
    LawError
        It is no name.
    """
    where, _, name = text.rpartition(":")
    if not where or not name:
        raise LawError(f"controller {text!r} is not allowed; {_FORM}")
    if where == GIVEN:
        raise LawError(f"controller {name}: was given in Python and is in no file; put it into one")
    return f"{Path(where).absolute()}:{name}" if where.endswith(".py") else text


def short_name(source: str) -> str:
    """A controller's name for people: without the folder of its file."""
    where, _, name = source.rpartition(":")
    return f"{Path(where).stem}:{name}" if where.endswith(".py") else source


def source_of(controller: Any) -> str:
    """How another process finds what is given; its module is GIVEN where it cannot."""
    name, module = _name_of(controller), getattr(controller, "__module__", None)
    known = sys.modules.get(module or "")
    for part in name.split("."):
        known = getattr(known, part, None)
    return f"{module}:{name}" if known is controller and module != "__main__" else f"{GIVEN}:{name}"


def find(text: str) -> PythonLaw:
    """Import a controller by its name. **This runs the code of the module that is named.**

    Parameters
    ----------
    text : str
        MODULE:NAME, of a module that Python finds, or that lies in the present folder; or
        FILE.py:NAME.

    Raises
    ------
    LawError
        One sentence: not found, cannot be imported, or no controller.
    """
    source = full_source(text)
    where, _, name = source.rpartition(":")
    short = short_name(source)
    try:
        module = _of_file(Path(where)) if where.endswith(".py") else _of_module(where)
    except (Exception, SystemExit) as error:
        raise LawError(f"controller {short}: cannot be imported: {in_one_line(error)}") from error
    target: Any = module
    for part in name.split("."):
        if not hasattr(target, part):
            raise LawError(
                f"controller {short}: {getattr(module, '__file__', where)} has no {name}"
            )
        target = getattr(target, part)
    return PythonLaw(target, short, source)


def _of_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    _look_in(path.parent)
    name = f"heli_law_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _of_module(name: str) -> ModuleType:
    _look_in(Path.cwd())
    importlib.invalidate_caches()
    return importlib.import_module(name)


def _look_in(folder: Path) -> None:
    """Find what a controller imports beside itself; last, so that it hides nothing."""
    if os.fspath(folder) not in sys.path:
        sys.path.append(os.fspath(folder))
