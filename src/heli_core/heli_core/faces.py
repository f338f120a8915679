# SPDX-License-Identifier: Apache-2.0
"""The public face of a package: names that users import, each loaded when it is first asked for.

So `import heli_inner_hinf` costs nothing, and `from heli_inner_hinf import synthesize` loads what
synthesis needs. A module is named where the function would hide it (`trim.trim`).
"""

from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from typing import Any


def face(
    package: str, names: Mapping[str, Iterable[str]], modules: Iterable[str] = ()
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """`__getattr__`, `__dir__` and `__all__` of a package's `__init__.py` (PEP 562).

    Parameters
    ----------
    package : str
        The package's `__name__`.
    names : mapping of module name to names
        What users import, by the module of the package that defines it; a module of another
        package is named whole (`heli_core.errors`).
    modules : iterable of str
        Modules of the package that are public themselves.
    """
    owner = {name: module for module, exported in names.items() for name in exported}
    public = sorted({*owner, *modules})

    def load(name: str) -> Any:
        if name in modules:
            return import_module(f"{package}.{name}")
        if name not in owner:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module = owner[name]
        home = module if module.startswith("heli_") else f"{package}.{module}"
        return getattr(import_module(home), name)

    return load, lambda: public, public
