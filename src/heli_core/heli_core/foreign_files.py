# SPDX-License-Identifier: Apache-2.0
"""Files of strangers: what is opened, how much of it is read, what YAML, JSON and arrays may be.

A few bytes can ask for any amount of memory: YAML that names itself, a compressed zero, a count
that lies, `/dev/zero`. So every file that somebody else may have made comes through here, and what
is made of it has a budget, `HELI_MEMORY_MB`, that is asked before it is made. What is refused is a
`FileError`: a cause and one sentence.
"""

import io
import json
import os
import stat
import zipfile
import zlib
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
import yaml

from heli_core.errors import CausedError

# -------------------------------------------------------------------------------------------------
# The budget, and the causes.
# -------------------------------------------------------------------------------------------------

BUDGET_VARIABLE = "HELI_MEMORY_MB"
BUDGET_MB = 64
"""Without a word of the environment. A reader needs three times that beside its libraries."""
_MOST_MB = 1 << 20

MOST_TEXT_BYTES = 1 << 22
"""Of a file that is YAML or JSON; the largest one of ours has a tenth of a megabyte."""
MOST_YAML_NODES, MOST_YAML_DEPTH = 50_000, 64
_LONGEST_NUMBER = 200
# A file with less than a sixteenth of its bytes on the disk has holes, which read as zeros.
_SPARSE, _BLOCK = 16, 512
_MOST_ARRAYS = 100

# libyaml where it is built in: ten times faster, and a node reads three files at start.
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_TEXT, _NUMBERS = "tag:yaml.org,2002:str", ("int", "float", "timestamp", "binary")


class FileCause(Enum):
    """Why a file is refused."""

    UNREADABLE = "it is missing or cannot be read"
    NOT_REGULAR = "it is a device, a pipe, a socket or a folder"
    TOO_LARGE = "it is larger than the budget, or would become so"
    SPARSE = "it has holes for most of its size"
    NOT_TEXT = "it is not UTF-8"
    SYNTAX = "it is not what its name says"
    ALIAS = "YAML names a part of itself"
    TOO_DEEP = "it is nested too deeply"
    TOO_MANY = "it holds too many values"
    LONG_NUMBER = "a number has too many digits"
    BUDGET = "the environment names no budget"


class FileError(CausedError):
    """A file that is refused.

    Attributes
    ----------
    cause : FileCause
    problem : str
        What is wrong, without the file's name.
    line : int
        Of the text, from 1; 0 where it is not known.
    """

    def __init__(self, cause: FileCause, problem: str, path: object = "", line: int = 0) -> None:
        place = f"{path}:{line}" if line else str(path)
        super().__init__(cause, f"{place}: {problem}" if place else problem)
        self.problem, self.line = problem, line


def budget_bytes() -> int:
    """Bytes that may be made of a file at once: a chunk, a message, a record, all arrays of a file.

    Raises
    ------
    FileError
        `HELI_MEMORY_MB` is no whole number of megabytes from 1 on.
    """
    text = os.environ.get(BUDGET_VARIABLE, "")
    if not text:
        return BUDGET_MB << 20
    if not (text.isascii() and text.isdigit() and len(text) <= 7 and 0 < int(text) <= _MOST_MB):
        problem = f"{text!r:.20} is not allowed; allowed: megabytes from 1 to {_MOST_MB}"
        raise FileError(FileCause.BUDGET, problem, BUDGET_VARIABLE)
    return int(text) << 20


def within_budget(size: int, what: str, path: object = "", share: int = 1) -> None:
    """Raise FileError if something of a size, bytes, is over a share (1 / `share`) of the budget.

    `what` begins the sentence: "a chunk".
    """
    most = budget_bytes() // share
    if size > most:
        raise too_large(f"{what} of {size / 2**20:.0f} MB", path, most)


def too_large(what: str, path: object = "", most: int = 0) -> FileError:
    """The refusal that names what is too large and how to allow it."""
    allowed = most or budget_bytes()
    problem = f"{what} is too large; allowed: {allowed / 2**20:g} MB, {BUDGET_VARIABLE} raises it"
    return FileError(FileCause.TOO_LARGE, problem, path)


# -------------------------------------------------------------------------------------------------
# Opened, and read as a whole.
# -------------------------------------------------------------------------------------------------

_KINDS = (
    (stat.S_ISDIR, "a folder"), (stat.S_ISFIFO, "a pipe"), (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"), (stat.S_ISSOCK, "a socket"),
)  # fmt: skip


def open_regular(path: str | Path) -> BinaryIO:
    """Open a file to be read, if it is one: no pipe, device or socket, which may never end.

    Raises
    ------
    FileError
        Missing, unreadable, no regular file, or a sparse one above the budget.
    """
    try:
        # A pipe without a writer would wait for one.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise FileError(FileCause.UNREADABLE, reason, path) from None
    try:
        state = os.fstat(descriptor)
        kind = next((name for test, name in _KINDS if test(state.st_mode)), "")
        if kind:
            raise FileError(FileCause.NOT_REGULAR, f"it is {kind}, no file", path)
        sparse = state.st_blocks * _BLOCK * _SPARSE < state.st_size
        if sparse and state.st_size > budget_bytes():
            problem = f"it has {state.st_size / 2**20:.0f} MB, of which nearly all are holes"
            raise FileError(FileCause.SPARSE, problem, path)
        return cast(BinaryIO, os.fdopen(descriptor, "rb"))
    except BaseException:
        os.close(descriptor)
        raise


def read_bytes(path: str | Path, most: int | None = None) -> bytes:
    """Content of a file of at most so many bytes, or of the budget; raises FileError."""
    limit = budget_bytes() if most is None else most
    with open_regular(path) as file:
        try:
            # It may grow meanwhile, or be one of /proc, which has no size.
            content = file.read(limit + 1)
        except OSError as error:
            raise FileError(FileCause.UNREADABLE, error.strerror or str(error), path) from None
    if len(content) > limit:
        if most is None:
            raise too_large("a file of more", path)
        problem = f"it is too large for a file of its kind; allowed: {most / 2**20:g} MB"
        raise FileError(FileCause.TOO_LARGE, problem, path)
    return content


def read_text(path: str | Path, most: int = MOST_TEXT_BYTES) -> str:
    """Content of a text file, UTF-8, of at most so many bytes; raises FileError."""
    try:
        # As a text file's: ends of lines of any kind.
        return io.TextIOWrapper(io.BytesIO(read_bytes(path, most)), encoding="utf-8").read()
    except UnicodeDecodeError:
        raise FileError(FileCause.NOT_TEXT, "it is not UTF-8", path) from None


# -------------------------------------------------------------------------------------------------
# YAML.
# -------------------------------------------------------------------------------------------------


def compose_yaml(text: str, path: object = "") -> yaml.Node | None:
    """The nodes of a YAML text, without aliases, of bounded size, number and depth.

    Parameters
    ----------
    text : str
    path : path or str
        Begins the sentence of an error.

    Returns
    -------
    yaml.Node or None
        None for an empty text.

    Raises
    ------
    FileError
    """
    if len(text) > MOST_TEXT_BYTES:
        problem = f"it is too long; allowed: {MOST_TEXT_BYTES} characters"
        raise FileError(FileCause.TOO_LARGE, problem, path)
    try:
        _check_events(text, path)
        return yaml.compose(text, Loader=_LOADER)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        parts = (getattr(error, "context", None), getattr(error, "problem", None))
        problem = ", ".join(filter(None, parts)) or str(error).splitlines()[0]
        sentence = f"not valid YAML: {problem}"
        line = 0 if mark is None else mark.line + 1
        raise FileError(FileCause.SYNTAX, sentence, path, line) from error


def _check_events(text: str, path: object) -> None:
    depth = nodes = 0
    for event in yaml.parse(text, Loader=_LOADER):
        line = event.start_mark.line + 1 if event.start_mark else 0
        if isinstance(event, yaml.AliasEvent):
            raise FileError(FileCause.ALIAS, "YAML aliases are not allowed", path, line)
        if isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        elif isinstance(event, yaml.NodeEvent):
            nodes += 1
            depth += isinstance(event, yaml.CollectionStartEvent)
        if depth > MOST_YAML_DEPTH:
            problem = f"not valid YAML: nested too deeply; allowed: {MOST_YAML_DEPTH} levels"
            raise FileError(FileCause.TOO_DEEP, problem, path, line)
        if nodes > MOST_YAML_NODES:
            problem = f"it holds too many values; allowed: {MOST_YAML_NODES}"
            raise FileError(FileCause.TOO_MANY, problem, path, line)


def _scalars(root: yaml.Node | None) -> Iterator[yaml.ScalarNode]:
    todo = [] if root is None else [root]
    while todo:
        node = todo.pop()
        if isinstance(node, yaml.ScalarNode):
            yield node
        elif isinstance(node, yaml.MappingNode):
            todo += [one for pair in node.value for one in pair]
        else:
            todo += node.value


def load_yaml(text: str, path: object = "") -> Any:
    """What a YAML text says: dictionaries, lists, numbers, texts; raises FileError."""
    root = compose_yaml(text, path)
    for node in _scalars(root):
        is_number = node.tag.rpartition(":")[2] in _NUMBERS
        if is_number and len(node.value) > _LONGEST_NUMBER:
            problem = f"a number of {len(node.value)} characters; allowed: {_LONGEST_NUMBER}"
            raise FileError(FileCause.LONG_NUMBER, problem, path, node.start_mark.line + 1)
    if root is None:
        return None
    loader = _LOADER("")
    try:
        return loader.construct_document(root)
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        # A date that is none, a tag of a stranger's.
        problem = getattr(error, "problem", None) or str(error)
        raise FileError(FileCause.SYNTAX, f"not valid YAML: {problem}", path) from error
    finally:
        loader.dispose()


def read_yaml(path: str | Path) -> Any:
    """What a YAML file says; raises FileError."""
    return load_yaml(read_text(path), path)


# -------------------------------------------------------------------------------------------------
# JSON.
# -------------------------------------------------------------------------------------------------


def load_json(text: str, path: object = "") -> Any:
    """What a JSON text says; raises FileError."""
    if len(text) > MOST_TEXT_BYTES:
        problem = f"it is too long; allowed: {MOST_TEXT_BYTES} characters"
        raise FileError(FileCause.TOO_LARGE, problem, path)
    try:
        return json.loads(text)
    except RecursionError:
        raise FileError(FileCause.TOO_DEEP, "not valid JSON: nested too deeply", path) from None
    except json.JSONDecodeError as error:
        sentence = f"not valid JSON: {error.msg}"
        raise FileError(FileCause.SYNTAX, sentence, path, error.lineno) from None
    except ValueError:
        sentence = "not valid JSON: a number has too many digits"
        raise FileError(FileCause.LONG_NUMBER, sentence, path) from None


def read_json(path: str | Path) -> Any:
    """What a JSON file says; raises FileError."""
    return load_json(read_text(path), path)


# -------------------------------------------------------------------------------------------------
# Arrays, as numpy's `savez` writes them.
# -------------------------------------------------------------------------------------------------


def read_arrays(path: str | Path) -> dict[str, np.ndarray]:
    """Arrays of an .npz file by name; no pickled objects.

    Together they have at most the budget, or the size of their file where that is larger: arrays
    that are not compressed cannot lie.

    Raises
    ------
    FileError
    """
    with open_regular(path) as file:
        try:
            with zipfile.ZipFile(file) as members:
                return _arrays(members, os.fstat(file.fileno()).st_size, path)
        except FileError:
            raise
        except (OSError, ValueError, TypeError, EOFError, RuntimeError, MemoryError, SyntaxError,
                OverflowError, LookupError, NotImplementedError, zipfile.BadZipFile, zlib.error,
                RecursionError) as error:  # fmt: skip
            sentence = f"holds no arrays: {' '.join(str(error).split())[:_LONGEST_NUMBER]}"
            raise FileError(FileCause.SYNTAX, sentence, path) from None


def _arrays(members: zipfile.ZipFile, file_size: int, path: object) -> dict[str, np.ndarray]:
    infos = members.infolist()
    if len(infos) > _MOST_ARRAYS:
        problem = f"holds {len(infos)} arrays; allowed: {_MOST_ARRAYS}"
        raise FileError(FileCause.TOO_MANY, problem, path)
    whole = sum(member.file_size for member in infos)
    if whole > file_size:
        within_budget(whole, "arrays", path)
    arrays = {}
    for member in infos:
        if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError("an array is compressed in another way than numpy does")
        with members.open(member) as stream:
            _check_claim(stream, member.file_size)
        with members.open(member) as stream:
            array = np.lib.format.read_array(stream, allow_pickle=False)
        arrays[member.filename.removesuffix(".npy")] = array
    return arrays


def _check_claim(stream: Any, size: int) -> None:
    """ValueError where an array's head claims more than there is."""
    version = np.lib.format.read_magic(stream)
    heads = {(1, 0): np.lib.format.read_array_header_1_0,
             (2, 0): np.lib.format.read_array_header_2_0}  # fmt: skip
    if version not in heads:
        raise ValueError(f"an array of version {version}")
    shape, _, dtype = heads[version](stream)
    claimed = dtype.itemsize
    for length in shape:
        claimed *= length
    if dtype.hasobject or not dtype.itemsize or claimed > size:
        raise ValueError("an array that is not there")
