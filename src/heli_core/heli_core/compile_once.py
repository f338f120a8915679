# SPDX-License-Identifier: Apache-2.0
"""What numba does again and again while it compiles, done once for the kernels of this stack.

Linking. numba writes the code of each kernel into that of every kernel that calls it, and so on up
the tree; LLVM optimises and writes it anew each time: for the kernels of a flight three times the
code. Here a caller gets the code of small kernels, and of those that are always inlined; a large
one stands in memory once, and its callers jump to it. What is computed is the same, bit for bit. In
the cache a kernel brings along the machine code of the large ones below it, so that it can be
loaded alone; what is loaded already is not loaded again.

Types. numba tries all forms of an operator anew at each place where it stands. Here an operator's
answer for plain numbers and arrays is kept.

Events. numba tells two functions of each call of LLVM, though nobody listens.

This replaces methods of numba, in this process. Where a numba has other methods, it compiles as it
does by itself: slower, to the same results.
"""

import contextlib
import re
from collections.abc import Iterator
from hashlib import blake2s
from typing import Any

from numba.core import types
from numba.core.codegen import JITCodeLibrary, ll
from numba.core.types.functions import BaseFunction

LARGE_INSTRUCTIONS = 150
"""A kernel of at least so many instructions of LLVM's is called by its address.

A jump costs a few nanoseconds; a small kernel is better written into its callers.
"""

# -------------------------------------------------------------------------------------------------
# Linking.
# -------------------------------------------------------------------------------------------------

_OURS = re.compile(r"_ZN\d+heli_")  # numba's name of a function in a module of this stack
_KIND = "heli_large"  # of a library in the cache, beside numba's "object" and "bitcode"
_Library: Any = JITCodeLibrary
_Function: Any = BaseFunction
_METHODS = (
    "_finalize_final_module",
    "_get_compiled_object",
    "_set_compiled_object",
    "_unserialize",
    "enable_object_caching",
    "finalize",
    "serialize_using_object_code",
)
_loaded: dict[bytes, Any] = {}  # libraries of large kernels in this process, by digest


class LargeKernel:
    """Machine code of a large kernel, as the cache keeps it."""

    __slots__ = ("code", "digest", "name", "symbols")

    def __init__(self, library: Any) -> None:
        self.name: str = library.name
        self.code: bytes = library._get_compiled_object()
        self.symbols = tuple(_defined(library._final_module))
        self.digest = blake2s(self.code, digest_size=16).digest()


def _defined(module: Any) -> Iterator[str]:
    """Names of the functions and variables that a module defines."""
    for values in (module.functions, module.global_variables):
        yield from (value.name for value in values if not value.is_declaration)


def is_large(module: Any) -> bool:
    """Whether a module of LLVM's is a kernel of this stack that is called by its address."""
    instructions = 0
    for function in module.functions:
        if function.is_declaration or not _OURS.match(function.name):
            continue
        if any(b"alwaysinline" in attributes for attributes in function.attributes):
            return False
        instructions += sum(1 for block in function.blocks for _ in block.instructions)
    return instructions >= LARGE_INSTRUCTIONS


def _as_large(library: Any) -> LargeKernel | None:
    """The kernel of a finished library, if it is a large one."""
    if not hasattr(library, "_large"):
        large = library._object_caching_enabled and is_large(library._final_module)
        library._large = LargeKernel(library) if large else None
        if library._large is not None:
            _loaded[library._large.digest] = library
    kernel: LargeKernel | None = library._large
    return kernel


def _below(library: Any) -> list[LargeKernel]:
    """The large kernels that a library jumps to, a called one before its callers."""
    return getattr(library, "_large_below", [])


def _finalize(self: Any) -> None:
    """As numba's, but large kernels are not linked in."""
    below: dict[bytes, LargeKernel] = {}
    linked = []
    for library in dict.fromkeys(self._linking_libraries):
        library._ensure_finalized()
        below.update((kernel.digest, kernel) for kernel in _below(library))
        kernel = _as_large(library)
        if kernel is None:
            linked.append(library)
        else:
            self._reload_init.update(library._reload_init)
            below[kernel.digest] = kernel
    self._large_below = list(below.values())
    self._linking_libraries = linked
    _numba_finalize(self)


def _serialize(self: Any) -> Any:
    """As numba's, with the large kernels below; a large one itself needs no code to link in."""
    kernel = _as_large(self)
    if kernel is None and not _below(self):
        return _numba_serialize(self)
    return self.name, _KIND, (_below(self), kernel or _numba_serialize(self))


def _load(generator: Any, kernel: LargeKernel) -> Any:
    """Library of a large kernel, once in a process."""
    library = _loaded.get(kernel.digest)
    if library is None:
        library = generator.create_library(kernel.name)
        library.enable_object_caching()
        library._set_compiled_object(kernel.code)
        library._large = kernel
        library._finalize_final_module()
        generator._engine._defined_symbols.update(kernel.symbols)
        _loaded[kernel.digest] = library
    return library


def _unserialize(_cls: Any, generator: Any, state: Any) -> Any:
    _name, kind, data = state
    if kind != _KIND:
        return _numba_unserialize(generator, state)
    below, own = data
    for kernel in below:
        _load(generator, kernel)
    if isinstance(own, LargeKernel):
        library = _load(generator, own)
    else:
        library = _numba_unserialize(generator, own)
    library._large_below = below
    return library


# -------------------------------------------------------------------------------------------------
# Types.
# -------------------------------------------------------------------------------------------------

_PLAIN = (types.Number, types.Boolean, types.Literal, types.NoneType, types.Array)


def _get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
    """As numba's; the answer for plain arguments is kept."""
    if kws or not all(isinstance(kind, _PLAIN) for kind in args):
        return _numba_get_call_type(self, context, args, kws)
    kept = self.__dict__.setdefault("_kept_signatures", {})
    if args not in kept:
        kept[args] = _numba_get_call_type(self, context, args, kws)
    return kept[args]


# -------------------------------------------------------------------------------------------------
# All of it.
# -------------------------------------------------------------------------------------------------

_numba_finalize: Any = getattr(_Library, "finalize", None)
_numba_serialize: Any = getattr(_Library, "serialize_using_object_code", None)
_numba_unserialize: Any = getattr(_Library, "_unserialize", None)
_numba_get_call_type: Any = _Function.get_call_type


def install() -> None:
    """Compile so from now on, in this process; a second call changes nothing."""
    if _Library.finalize is _finalize or not all(hasattr(_Library, name) for name in _METHODS):
        return
    _Library.finalize = _finalize
    _Library.serialize_using_object_code = _serialize
    _Library._unserialize = classmethod(_unserialize)
    _Function.get_call_type = _get_call_type
    with contextlib.suppress(AttributeError):  # no such list: the events stay
        ll.ffi.lib._lock._cblist.clear()
