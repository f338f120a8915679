# SPDX-License-Identifier: Apache-2.0
"""Run the notebooks of examples/notebooks, each in a Jupyter kernel of its own.

    ./heli python scripts/notebooks.py            run them, and store what they print and draw
    ./heli python scripts/notebooks.py --check    run them, and say where that differs

Outputs are stored, so that GitHub and the site show them; a test runs them anew and compares. Words
must be the same, numbers to their last digit, of pictures only that there is one: another processor
rounds otherwise. Names of notebooks may be given. Needs the test tools (./run_tests.sh).
"""

import argparse
import re
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parents[1] / "examples" / "notebooks"
LIMIT_S = 280
_NUMBER = re.compile(r"[-+]?\d+(?:\.(\d+))?(?:e([-+]?\d+))?")
_RELATIVE = 1e-3
_BY_RICH = '<pre style="white-space:pre'
"""So begins what a console of rich prints in a kernel: that something compiles, or takes long."""


def notebooks(names: Sequence[str] = ()) -> list[Path]:
    """The notebooks, or those whose names begin so."""
    found = sorted(FOLDER.glob("*.ipynb"))
    return [path for path in found if not names or path.name.startswith(tuple(names))]


def run(path: Path) -> Any:
    """Run a notebook in its folder; returns it with its outputs, tidied.

    Raises
    ------
    nbclient.exceptions.CellExecutionError
        A cell raised.
    """
    import nbformat
    from nbclient import NotebookClient
    from traitlets.config import Config

    book = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory(prefix="heli_nb.") as folder:
        # Sockets that are files: nobody else can speak to the kernel, and no port is taken.
        sockets = {"transport": "ipc", "ip": str(Path(folder, "kernel"))}
        client = NotebookClient(
            book,
            config=Config({"KernelManager": sockets}),
            timeout=LIMIT_S,
            kernel_name="python3",
            resources={"metadata": {"path": str(path.parent)}},
            record_timing=False,
            # On a loaded machine one text comes in several messages.
            coalesce_streams=True,
        )
        client.execute()
    return tidied(book)


def tidied(book: Any) -> Any:
    """A notebook without what differs from run to run: progress on stderr, versions, widgets."""
    book.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    for number, cell in enumerate(book.cells, 1):
        cell.id, cell.metadata = f"cell-{number:02d}", {}
        if cell.cell_type == "code":
            outputs = [o for o in cell.outputs if not _of_the_run(o)]
            for output in outputs:
                if "data" in output:
                    output.metadata = {}
            cell.outputs = outputs
    return book


def _of_the_run(output: Any) -> bool:
    """Whether it tells how the run goes: on stderr, or by rich, which a kernel shows as HTML."""
    page = output.get("data", {}).get("text/html", "")
    return output.get("name") == "stderr" or "".join(page).startswith(_BY_RICH)


def texts(output: Any) -> dict[str, str]:
    """What an output says, by its kind; of a picture an empty text."""
    if output.output_type == "stream":
        return {"stdout": output.text}
    return {
        kind: "" if kind.startswith("image/") else text
        for kind, text in output.get("data", {}).items()
    }


def same(one: str, two: str) -> bool:
    """Whether texts have the same words, and numbers that differ in the last digit at most."""
    if _NUMBER.sub("#", one).split() != _NUMBER.sub("#", two).split():
        return False
    pairs = zip(_NUMBER.finditer(one), _NUMBER.finditer(two), strict=True)
    return all(_near(first, second) for first, second in pairs)


def _near(one: re.Match[str], two: re.Match[str]) -> bool:
    a, b = float(one[0]), float(two[0])
    if one[1] is None and one[2] is None and two[1] is None:
        return a == b or min(abs(a), abs(b)) >= 1.0 / _RELATIVE and _close(a, b, 1.0)
    last = 10.0 ** (int(one[2] or 0) - len(one[1] or ""))
    return _close(a, b, last)


def _close(a: float, b: float, last: float) -> bool:
    return abs(a - b) <= max(1.001 * last, _RELATIVE * abs(a))


def differences(stored: Any, fresh: Any) -> Iterator[str]:
    """Where a fresh run says something else than what is stored, a line each."""
    for old, new in zip(stored.cells, fresh.cells, strict=True):
        if old.cell_type != "code":
            continue
        said, says = ([texts(o) for o in cell.outputs] for cell in (old, new))
        if [sorted(o) for o in said] != [sorted(o) for o in says]:
            yield f"{old.id}: outputs of another kind, or none; stored {said}, fresh {says}"
            continue
        for one, two in zip(said, says, strict=True):
            for kind in one:
                if not same(one[kind], two[kind]):
                    yield f"{old.id}, {kind}: stored\n{one[kind]}\nfresh\n{two[kind]}"


def check(path: Path) -> list[str]:
    """Run a notebook, and compare with what is stored."""
    import nbformat

    return list(differences(nbformat.read(path, as_version=4), run(path)))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, and store or compare; returns the exit code."""
    parser = argparse.ArgumentParser(description="Run the notebooks of examples/notebooks.")
    parser.add_argument("names", nargs="*", help="beginnings of names (default: all)")
    parser.add_argument("--check", action="store_true", help="compare, and store nothing")
    given = parser.parse_args(arguments)
    try:
        import nbformat
        from nbclient.exceptions import CellExecutionError
    except ModuleNotFoundError as missing:
        print(f"error: {missing.name} is missing; ./run_tests.sh installs it", file=sys.stderr)
        return 2
    wrong = 0
    for path in notebooks(given.names):
        begun = time.monotonic()
        try:
            found = check(path) if given.check else []
            if not given.check:
                nbformat.write(run(path), path)
        except CellExecutionError as error:
            found = [f"{error.ename}: {error.evalue}"]
        print(f"{path.name}: {time.monotonic() - begun:.1f} s")
        for line in found:
            print(f"error: {path.name}: {line}", file=sys.stderr)
        wrong += bool(found)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
