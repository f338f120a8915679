# SPDX-License-Identifier: Apache-2.0
"""The one decorator for compiled kernels.

numba's own file cache looks only at the file of the function itself: a changed callee, or a changed
constant, in another file would leave a stale caller behind. So each module with kernels has a cache
folder that is named after the content of all source files that it imports, directly or not: a
change of any of them starts an empty folder, a change anywhere else leaves the kernels alone.

A module takes part by using the decorator; there is no list of packages. Followed are imports of
the module's own top-level package and of the packages of this stack (`heli_*`), in functions too.
"""

import hashlib
import math
import os
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numba import config, typeof
from numba.core import cgutils
from numba.core import types as numba_types
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    intrinsic,
    lower_builtin,
    lower_getattr_generic,
    models,
    register_model,
    type_callable,
    typeof_impl,
    unbox,
)

from heli_core import compile_once
from heli_core.folders import make_private, others_may_replace, temporary_folder

# -------------------------------------------------------------------------------------------------
# Jit.
# -------------------------------------------------------------------------------------------------

types: Any = numba_types  # what its stubs do not know
_STACK = "heli_"
_KEPT_S = 30 * 86400.0
_IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+([.\w]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)|import[ \t]+([^\n]+))",
    re.MULTILINE,
)

# LLVM's higher levels cost a sixth of the time to compile and give flights no speed (benchmarks:
# `scripts/bench_plant.py`); none changes a bit, as floating point stays in its order.
if "NUMBA_OPT" not in os.environ:
    config.OPT = type(config.OPT)(1)  # type: ignore[attr-defined]
compile_once.install()


@cache
def _file_of(module: str) -> Path | None:
    """Source file of a module or package, without importing it; None if it is none."""
    top, *rest = module.split(".")
    spec = find_spec(top)
    if spec is None or spec.origin is None:
        return None
    path = Path(spec.origin)
    if path.name != "__init__.py":
        return None if rest else path
    for part in rest:
        folder = path.parent / part
        path = folder / "__init__.py" if folder.is_dir() else folder.with_suffix(".py")
    return path if path.is_file() else None


def _imported(source: str, package: str) -> Iterator[str]:
    """Names that a module's source may import; names of attributes are among them.

    Parameters
    ----------
    source : str
    package : str
        Package of the module, for relative imports.
    """
    for origin, names, plain in _IMPORT.findall(source):
        if plain:
            yield from (part.split(" as ")[0].strip() for part in plain.split(","))
            continue
        level = len(origin) - len(origin.lstrip("."))
        if level:
            base = package.split(".")[: len(package.split(".")) - level + 1]
            origin = ".".join([*base, origin[level:]]).rstrip(".")
        yield origin
        words = re.sub(r"#[^\n]*", "", names).strip("()").split(",")
        yield from (f"{origin}.{word.split(' as ')[0].strip()}" for word in words)


@cache
def _imports_of(path: Path, package: str) -> tuple[bytes, tuple[str, ...]]:
    content = path.read_bytes()
    return content, tuple(_imported(content.decode(), package))


def _sources(module: str, path: Path) -> dict[str, Path]:
    """Files that a module's kernels may depend on: its own and all that it imports, by name."""
    top_package = module.split(".")[0]
    files = {module: path}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        file = files[name]
        package = name if file.name == "__init__.py" else name.rpartition(".")[0]
        for wanted in _imports_of(file, package)[1]:
            top = wanted.split(".")[0]
            if wanted in files or not (top == top_package or top.startswith(_STACK)):
                continue
            target = _file_of(wanted)
            if target is not None:
                files[wanted] = target
                waiting.append(wanted)
    return files


@cache
def source_digest(module: str, path: Path) -> str:
    """Hash (hex, 16 characters) of all sources that bear on the kernels of a module."""
    digest = hashlib.sha256(sys.version.encode())
    for name, file in sorted(_sources(module, path).items()):
        package = name if file.name == "__init__.py" else name.rpartition(".")[0]
        content = _imports_of(file, package)[0]
        digest.update(f"{name}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()[:16]


KERNEL_CACHE = "HELI_KERNEL_CACHE"
"""Names the folder for compiled kernels, where the user wants another one (environment)."""


def _cache_places() -> Iterator[Path]:
    """Folders that may hold the cache, the best first.

    The one that the user names; that of the virtual environment that runs this, which holds the
    code that is run anyway, so that a new HOME compiles nothing anew; the user's own. A relative
    path is ignored (XDG Base Directory Specification).
    """
    if named := os.environ.get(KERNEL_CACHE):
        yield Path(named)
    if sys.prefix != sys.base_prefix:
        yield Path(sys.prefix) / "var" / "cache"
    for variable, below in (("XDG_CACHE_HOME", ""), ("HOME", ".cache")):
        folder = Path(os.environ.get(variable, ""))
        if folder.is_absolute():
            yield folder / below


@cache
def cache_root() -> Path:
    """Folder of compiled kernels: the first usable place, else the system's temporary folder.

    What lies there is run: a folder that is not this user's own, or that others may replace, is not
    taken.
    """
    for place in _cache_places():
        root = place / "heli_hover" / "kernels"
        try:
            place.mkdir(parents=True, exist_ok=True)
            usable = not others_may_replace(place)
            usable = usable and make_private(root.parent) and make_private(root)
        except OSError:  # read-only, a file, full
            continue
        if usable and os.access(root, os.W_OK):
            return root
    return temporary_folder("kernels")


def _prune(root: Path) -> None:
    """Drop folders of sources that nobody has used for a month."""
    import shutil

    oldest = time.time() - _KEPT_S
    for folder in root.iterdir():
        try:
            if folder.stat().st_mtime < oldest:
                shutil.rmtree(folder, ignore_errors=True)
        except OSError:
            continue


@cache
def cache_folder(module: str, path: Path) -> Path:
    """Folder of a module's compiled kernels; made when it is missing."""
    folder = cache_root() / f"{module}-{source_digest(module, path)}"
    if folder.is_dir():
        os.utime(folder)
    else:
        folder.mkdir(parents=True, exist_ok=True)
        _prune(folder.parent)
    return folder


def is_compiled(kernel: Callable[..., Any]) -> bool:
    """Whether machine code of a kernel waits in the cache, as far as the files there tell.

    A process that has it in memory is not asked: who has called the kernel knows.
    """
    function = getattr(kernel, "py_func", None)
    if function is None or os.environ.get("NUMBA_CACHE_DIR"):
        return True
    path = Path(function.__code__.co_filename)
    # Of this source file: the same sources elsewhere on the machine have a folder of their own.
    cache: Any = getattr(kernel, "_cache", None)
    folder = Path(getattr(cache, "cache_path", cache_folder(function.__module__, path)))
    return any(folder.rglob(f"{path.stem}.{function.__qualname__}-*.nbi"))


def njit(
    function: Callable[..., Any],
    inlined: bool = False,
    unlocked: bool = False,
    counted: bool = False,
) -> Callable[..., Any]:
    """Compile a kernel: nopython, cached on disk, IEEE division (x/0 is inf, not an exception).

    Deliberately without fastmath: the same inputs give the same bits in the one-process loop and in
    the nodes, and NaN checks stay meaningful. NUMBA_CACHE_DIR, if set, is left in charge.
    Nobody counts references to arrays, which cost a third of a tick: a kernel makes its arrays by
    `heli_core.jit.scratch`, numba refuses others, and it gives none back but to kernels.
    `inlined`, `unlocked`, `counted`: see `njit_inlined`, `njit_unlocked`, `njit_counted`.
    """
    import numba

    path = Path(function.__code__.co_filename)
    if path.is_file() and not os.environ.get("NUMBA_CACHE_DIR"):
        # Not through the environment: a child process may run other sources than we do.
        numba.config.CACHE_DIR = str(cache_folder(function.__module__, path))  # type: ignore[attr-defined]
    # No kernel is called from C by its address.
    options: dict[str, Any] = {"error_model": "numpy", "_nrt": counted, "no_cfunc_wrapper": True}
    kernel = numba.njit(cache=True, forceinline=inlined, nogil=unlocked, **options)(function)
    if hasattr(kernel, "get_call_template"):  # not with NUMBA_DISABLE_JIT
        kernel.get_call_template = partial(_compiled_once, kernel.get_call_template)
    return kernel


def _compiled_once(get_call_template: Any, args: Any, kws: Any) -> Any:
    """One code for all calls: numba makes one for each constant that a caller hands over."""
    plain = {name: types.unliteral(kind) for name, kind in kws.items()}
    return get_call_template(tuple(map(types.unliteral, args)), plain)


def njit_inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """As `njit`, and always written into its callers.

    For a part that gives a tuple of many numbers back, by value: it would be copied. It changes no
    bit of what is computed.
    """
    return njit(function, inlined=True)


def njit_counted(function: Callable[..., Any]) -> Callable[..., Any]:
    """As `njit`, and it may make arrays and give them back.

    Not for what flies; nobody frees the arrays that such a kernel gives to one of `njit`.
    """
    return njit(function, counted=True)


def njit_unlocked(function: Callable[..., Any]) -> Callable[..., Any]:
    """As `njit`, and other Python threads run meanwhile.

    For a kernel that takes long, on arrays that its caller's thread alone knows.
    """
    return njit(function, unlocked=True)


# -------------------------------------------------------------------------------------------------
# Compiled kernels, called without the look at their arguments' types.
#
# numba looks at every number in a tuple of hundreds at each call, to find the code for its types.
# Where the types are known to stay, this look can be made once: it takes ten times as long as to
# hand
# the numbers over.
# -------------------------------------------------------------------------------------------------


def direct(kernel: Callable[..., Any], *like: Any) -> Callable[..., Any]:
    """The machine code of a kernel for arguments of these types.

    Parameters
    ----------
    kernel : callable
        As `heli_core.jit.njit` gives it.
    *like : object
        Arguments, all of them, as those of each call will be.

    Returns
    -------
    callable
        Computes the same, bit for bit. It takes positional arguments only, and does not check them:
        an array of another number of dimensions, kind or order would be read as if it were the
        one of `like`. So ask again when a tuple of numbers is swapped.
    """
    import numba

    if not hasattr(kernel, "overloads"):  # NUMBA_DISABLE_JIT
        return kernel
    code: Callable[..., Any] = kernel.compile(tuple(map(numba.typeof, like)))  # type: ignore[attr-defined]
    return code


# -------------------------------------------------------------------------------------------------
# Tuples of numbers and arrays, handed to kernels by reference.
#
# numba hands a NamedTuple over by value: each of its hundreds of numbers is an argument of every
# kernel on the way, and code that unpacks it stands in each. Those of `by_reference` are one
# address, of a block of 8-byte slots: a number, the address of another block, or of an array its
# data, lengths and strides.
# -------------------------------------------------------------------------------------------------

_Numbers = TypeVar("_Numbers", bound=tuple[Any, ...])
_SLOT = cgutils.intp_t  # of 8 bytes
_ADDRESS = "_address_of_numbers"


class ByReference(numba_types.Type):  # type: ignore[misc]
    """numba's type of a tuple that kernels get by its address.

    Attributes
    ----------
    cls : type
        NamedTuple, decorated by `by_reference`.
    members : dict
        numba type of each field.
    """

    def __init__(self, cls: type, members: tuple[Any, ...]) -> None:
        self.cls, self.members = cls, dict(zip(cls._fields, members, strict=True))  # type: ignore[attr-defined]
        # A short name: it stands in that of each kernel that takes one.
        digest = hashlib.blake2s(repr(members).encode(), digest_size=6).hexdigest()
        super().__init__(f"{cls.__module__}.{cls.__qualname__}.{digest}")


def by_reference(cls: type[_Numbers]) -> type[_Numbers]:
    """Class decorator of a NamedTuple that kernels get by its address.

    Python sees the same tuple; arrays in it change in place, as those of any tuple do. A kernel
    that makes one has it by value, until it goes through `referred`.
    """
    place = {
        "__module__": cls.__module__,
        "__qualname__": cls.__qualname__,
        "__doc__": cls.__doc__,
        _ADDRESS: _Address(),
        "__getstate__": lambda self: None,  # an address is nobody else's
    }
    made: Any = type(cls.__name__, (cls,), place)
    typeof_impl.register(made, _type_of_numbers)
    return made  # type: ignore[no-any-return]


def _type_of_numbers(value: Any, context: Any) -> ByReference:
    return ByReference(type(value), tuple(typeof_impl(member, context) for member in value))


class _Address:
    """Address of a tuple's block, which lives as long as the tuple does; made when first asked."""

    def __get__(self, numbers: Any, cls: type) -> Any:
        if numbers is None:
            return self
        words: list[int] = []
        for member, kind in zip(numbers, typeof(numbers).members.values(), strict=True):
            words += _words(member, kind)
        block = np.array(words, np.uint64)
        address = int(block.ctypes.data)
        numbers.__dict__.update({_ADDRESS: address, "_block": block})
        return address


def _words(value: Any, kind: Any) -> list[int]:
    """The slots of a member, as integers of their bits."""
    if isinstance(kind, ByReference):
        return [getattr(value, _ADDRESS)]
    if isinstance(kind, types.Array):
        return [value.ctypes.data, *value.shape, *(s & _ALL_BITS for s in value.strides)]
    if isinstance(kind, types.BaseTuple):
        return [word for part, of in zip(value, kind, strict=True) for word in _words(part, of)]
    if kind is types.none:
        return [0]
    if isinstance(kind, types.Float):
        return [int(np.float64(value).view(np.uint64))]
    return [int(value) & _ALL_BITS]


_ALL_BITS = (1 << 64) - 1


def _slots(kind: Any) -> int:
    if isinstance(kind, types.Array):
        return 1 + 2 * int(kind.ndim)
    if isinstance(kind, types.BaseTuple):
        return sum(map(_slots, kind))
    return 1


@register_model(ByReference)
class _ByReferenceModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: ByReference) -> None:
        super().__init__(manager, kind, cgutils.voidptr_t)


@unbox(ByReference)
def _unbox(kind: ByReference, numbers: Any, c: Any) -> NativeValue:
    address = c.pyapi.object_getattr_string(numbers, _ADDRESS)
    value = cgutils.alloca_once_value(c.builder, cgutils.get_null_value(cgutils.voidptr_t))
    with c.builder.if_then(cgutils.is_not_null(c.builder, address)):
        c.builder.store(c.pyapi.long_as_voidptr(address), value)
        c.pyapi.decref(address)
    return NativeValue(c.builder.load(value), is_error=c.pyapi.c_api_error())


@infer_getattr
class _Members(AttributeTemplate):  # type: ignore[misc]
    key = ByReference

    def generic_resolve(self, kind: ByReference, name: str) -> Any:  # type: ignore[override]
        return kind.members.get(name)


@lower_getattr_generic(ByReference)
def _member(context: Any, builder: Any, kind: ByReference, block: Any, name: str) -> Any:
    slot = 0
    for field, member in kind.members.items():
        if field == name:
            return _load(context, builder, member, block, slot)
        slot += _slots(member)
    raise AttributeError(name)


def _at(builder: Any, block: Any, slot: int, kind: Any) -> Any:
    """Pointer to a slot, as one to `kind`."""
    words = builder.bitcast(block, _SLOT.as_pointer())
    return builder.bitcast(builder.gep(words, [cgutils.int32_t(slot)]), kind.as_pointer())


def _load(context: Any, builder: Any, kind: Any, block: Any, slot: int) -> Any:
    def word(place: int, llvm: Any = _SLOT) -> Any:
        return builder.load(_at(builder, block, place, llvm))

    if isinstance(kind, types.Array):
        made = context.make_array(kind)(context, builder)
        n = kind.ndim
        data = context.get_data_type(kind.dtype).as_pointer()
        size = context.get_abi_sizeof(context.get_data_type(kind.dtype))
        context.populate_array(
            made,
            data=word(slot, data),
            shape=cgutils.pack_array(builder, [word(slot + 1 + i) for i in range(n)]),
            strides=cgutils.pack_array(builder, [word(slot + 1 + n + i) for i in range(n)]),
            itemsize=context.get_constant(types.intp, size),
            meminfo=None,
        )
        return made._getvalue()
    if isinstance(kind, types.BaseTuple):
        parts = []
        for part in kind:
            parts.append(_load(context, builder, part, block, slot))
            slot += _slots(part)
        return context.make_tuple(builder, kind, parts)
    if kind is types.none:
        return context.get_dummy_value()
    if isinstance(kind, types.Boolean):
        return builder.icmp_unsigned("!=", word(slot), _SLOT(0))
    return word(slot, context.get_value_type(kind))


def _referred(_context, numbers):  # type: ignore[no-untyped-def]
    kind = _kind_referred(numbers)

    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return _store(context, builder, signature.args[0], arguments[0])

    return kind(numbers), code


# Kernels that run as Python get the tuple itself.
referred: Any = (lambda numbers: numbers) if config.DISABLE_JIT else intrinsic(_referred)  # type: ignore[attr-defined]
"""A tuple that the kernel has made, by reference, for those that it calls.

Its numbers lie in the frame of the kernel that asks, so it must not be returned, nor kept.
"""


def _at_address(_context, like, address):  # type: ignore[no-untyped-def]
    if not isinstance(like, ByReference):
        return None

    def code(_context, builder, _signature, arguments):  # type: ignore[no-untyped-def]
        return builder.inttoptr(arguments[1], cgutils.voidptr_t)

    return like(like, address), code


at_address: Any = intrinsic(_at_address)
"""The tuple of `like`'s type whose block is at an address, of `addresses_of`: one call for many."""


def addresses_of(several: Iterable[Any]) -> np.ndarray:
    """Addresses (N,) of tuples of one `by_reference` type, valid as long as these live.

    Raises
    ------
    TypeError
        They are of several types.
    """
    several = list(several)
    if len({typeof(numbers) for numbers in several}) > 1:
        raise TypeError("tuples of several types have no kernel in common")
    return np.array([getattr(numbers, _ADDRESS) for numbers in several], np.int64)


def _kind_referred(kind: Any) -> Any:
    if not (isinstance(kind, types.BaseNamedTuple) and hasattr(kind.instance_class, _ADDRESS)):
        return kind
    return ByReference(kind.instance_class, tuple(map(_kind_referred, kind)))


def _store(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Address of a tuple by value, laid into the kernel's frame."""
    made = _kind_referred(kind)
    block = cgutils.alloca_once(builder, _SLOT, size=sum(map(_slots, made.members.values())))
    slot = 0
    for i, (part, of) in enumerate(zip(kind, made.members.values(), strict=True)):
        member = builder.extract_value(value, i)
        if isinstance(of, ByReference) and not isinstance(part, ByReference):
            member = _store(context, builder, part, member)
        slot = _store_member(context, builder, of, member, block, slot)
    return builder.bitcast(block, cgutils.voidptr_t)


def _store_member(context: Any, builder: Any, kind: Any, value: Any, block: Any, slot: int) -> int:
    """Write a member from a slot on; the slot behind it."""
    if isinstance(kind, types.BaseTuple):
        for i, part in enumerate(kind):
            member = builder.extract_value(value, i)
            slot = _store_member(context, builder, part, member, block, slot)
        return slot
    words = [value]
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        words = [array.data]
        for several in (array.shape, array.strides):
            words += cgutils.unpack_tuple(builder, several, kind.ndim)
    elif isinstance(kind, types.Boolean):
        words = [builder.zext(value, _SLOT)]
    elif kind is types.none:
        words = [_SLOT(0)]
    for word in words:
        builder.store(word, _at(builder, block, slot, word.type))
        slot += 1
    return slot


# -------------------------------------------------------------------------------------------------
# Small arrays in kernels: made on the stack, copied and filled by plain loops.
#
# numba's own slice assignment makes a copy where source and target may overlap, and costs seconds
# of
# compilation.
# -------------------------------------------------------------------------------------------------


def scratch(length: int) -> np.ndarray:
    """A float64 vector that lives as long as the kernel that asks for it; its numbers are anything.

    It lies on the stack: nothing is allocated, and a short one ends up in registers. So it must not
    be returned, nor kept.

    Parameters
    ----------
    length : int
        A number, or the name of a module's constant.
    """
    return np.empty(length)


def scratch_matrix(rows: int, columns: int) -> np.ndarray:
    """As `scratch`, a float64 matrix."""
    return np.empty((rows, columns))


def _type_of(*lengths: Any) -> Any:
    """Type of an array of these lengths; None, which numba asks for, if one is not a constant."""
    if all(isinstance(length, types.IntegerLiteral) for length in lengths):
        return types.Array(types.float64, len(lengths), "C")
    return None


@type_callable(scratch)
def _type_of_vector(_context: Any) -> Any:
    def typer(length):  # type: ignore[no-untyped-def]  # numba reads its signature
        return _type_of(length)

    return typer


@type_callable(scratch_matrix)
def _type_of_matrix(_context: Any) -> Any:
    def typer(rows, columns):  # type: ignore[no-untyped-def]
        return _type_of(rows, columns)

    return typer


@lower_builtin(scratch, types.IntegerLiteral)
@lower_builtin(scratch_matrix, types.IntegerLiteral, types.IntegerLiteral)
def _on_stack(context: Any, builder: Any, signature: Any, _arguments: Any) -> Any:
    """Code of an array in the frame of the kernel; nobody counts references to it."""
    shape = [length.literal_value for length in signature.args]
    number = context.get_data_type(types.float64)
    width = context.get_abi_sizeof(number)

    def integers(values: list[int]) -> Any:
        words = [context.get_constant(types.intp, value) for value in values]
        return cgutils.pack_array(builder, words)

    made = context.make_array(signature.return_type)(context, builder)
    context.populate_array(
        made,
        data=cgutils.alloca_once(builder, number, size=math.prod(shape)),
        shape=integers(shape),
        strides=integers([width * math.prod(shape[i + 1 :]) for i in range(len(shape))]),
        itemsize=context.get_constant(types.intp, width),
        meminfo=None,
    )
    return made._getvalue()


@njit
def copy_part(target, i, source, j, n):
    """target[i : i + n] = source[j : j + n] of contiguous vectors."""
    for m in range(n):
        target[i + m] = source[j + m]


@njit
def copy(target, source):
    """target[:] = source of vectors of one length."""
    for i in range(target.shape[0]):
        target[i] = source[i]


@njit
def difference(a, b, out):
    """out[:] = a - b of vectors of one length."""
    for i in range(out.shape[0]):
        out[i] = a[i] - b[i]


@njit
def is_zero(values):
    """Whether every number of a vector is 0; NaN is not."""
    for value in values:
        if value != 0.0:
            return False
    return True


@njit
def copy_matrix(target, source):
    """target[:, :] = source."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]


@njit
def fill(target, value):
    """target[:] = value of a contiguous vector."""
    for i in range(target.shape[0]):
        target[i] = value


@njit
def fill_matrix(target, value):
    """target[:, :] = value."""
    for i in range(target.shape[0]):
        for j in range(target.shape[1]):
            target[i, j] = value
