# SPDX-License-Identifier: Apache-2.0
"""A campaign's folder: its spec, who flies it, and its rows as Parquet, a file per task.

A file appears whole or not at all, so that a killed campaign goes on where it was.
"""

import contextlib
import json
import os
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from heli_flight.loop.commit import sources_commit
from heli_flight.studies.dispersion.row import NUMBER
from heli_flight.studies.dispersion.sampling import SEARCH
from heli_flight.studies.dispersion.spec import Spec
from heli_parameters.parameters import ParameterError

SPEC_NAME, ABOUT_NAME, ROWS = "spec.yaml", "campaign.json", "rows"
_PART = "part-{:08d}.parquet"
_TOLD = {"spec": str, "commit": str, "flights": int, "file": str, "flown": dict, "disperse": dict}


def about_of(folder: Path, option: str = "") -> dict[str, Any]:
    """What a campaign's folder says of itself; raises ParameterError if it holds none.

    Keys: `spec` (its identity), `commit`, `flights`, `file` (the spec's), `flown` (what all flights
    share, by name), `disperse` (each parameter's distribution, in words).
    """
    try:
        told = json.loads((folder / ABOUT_NAME).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ParameterError(f"{option}{folder}: holds no campaign: {error}") from None
    if not isinstance(told, dict) or any(
        not isinstance(told.get(key), kind) for key, kind in _TOLD.items()
    ):
        raise ParameterError(f"{option}{folder}: holds no campaign: {ABOUT_NAME} is of another")
    if told["flown"].get("sampling") == SEARCH:
        raise ParameterError(
            f"{option}{folder}: holds the flights of a search, which are no sample; its result is "
            f"in {folder}/result.json"
        )
    return told


def _about(spec: Spec, file: Path) -> dict[str, Any]:
    base = spec.base
    flown = {
        "kind": base.scenario.kind, "scenario": base.scenario_name, "world": base.world,
        "gps": base.gps, "laws": base.laws, "sampling": spec.sampling,
        "duration_s": float(base.scenario_parameters["duration_s"]),
    }  # fmt: skip
    return {
        "spec": spec.identity, "commit": sources_commit(), "flights": len(spec.inputs),
        "file": str(file.resolve()), "flown": flown,
        "disperse": {name: str(how) for name, how in spec.disperse.items()},
    }  # fmt: skip


@dataclass(frozen=True)
class Store:
    """The folder of a campaign.

    Attributes
    ----------
    folder : Path
    resumes : bool
        Whether `--resume` goes on with it.
    """

    folder: Path
    resumes: bool = True

    @classmethod
    def begin(cls, folder: Path, spec: Spec, file: Path, resumes: bool = True) -> "Store":
        """A new folder; raises ParameterError if there is one, or none can be made."""
        if folder.exists():
            way = "--resume goes on with it" if resumes else "name a new folder"
            raise ParameterError(f"--out {folder}: exists already; {way}")
        store = cls(folder, resumes)
        try:
            (folder / ROWS).mkdir(parents=True)
            shutil.copyfile(file, folder / SPEC_NAME)
            about = _about(spec, file)
            store._write(folder / ABOUT_NAME, json.dumps(about, indent=2).encode())
        except OSError as error:
            raise ParameterError(f"--out {folder}: {error.strerror or error}") from None
        return store

    @classmethod
    def resume(cls, folder: Path, spec: Spec) -> "Store":
        """The folder of a campaign that was broken off; ParameterError if it is of another."""
        about = about_of(folder, "--out ")
        if about["spec"] != spec.identity:
            raise ParameterError(
                f"--out {folder}: holds rows of another spec; allowed: the spec that it was begun "
                f"with ({folder / SPEC_NAME}), or another folder"
            )
        if about.get("commit") != sources_commit():
            raise ParameterError(
                f"--out {folder}: begun with the sources of {about.get('commit')}, these are "
                f"{sources_commit()}; allowed: the same, or another folder"
            )
        return cls(folder)

    @contextlib.contextmanager
    def kept_if_flown(self) -> Iterator[None]:
        """Take a folder without rows away again if what fills it fails."""
        try:
            yield
        except BaseException:
            if not self._parts():
                shutil.rmtree(self.folder, ignore_errors=True)
            raise

    def done(self) -> set[int]:
        """Numbers of the flights whose rows are here; a file that cannot be read is taken away."""
        found: set[int] = set()
        for part in self._parts():
            try:
                found |= set(pq.read_table(part, columns=[NUMBER])[NUMBER].to_pylist())
            except (pa.ArrowException, OSError):
                part.unlink()
        return found

    def put(self, rows: Sequence[dict[str, Any]]) -> None:
        """Keep the rows of a task.

        Raises
        ------
        ParameterError
            The disk is full, or the folder has gone.
        """
        names = dict.fromkeys(name for row in rows for name in row)
        table = pa.Table.from_pylist([{n: row.get(n) for n in names} for row in rows])
        sink = pa.BufferOutputStream()
        pq.write_table(table, sink, compression="zstd")
        part = self.folder / ROWS / _PART.format(min(row[NUMBER] for row in rows))
        try:
            self._write(part, sink.getvalue().to_pybytes())
        except OSError as error:
            stays = "what was flown stays" + ", --resume goes on" * self.resumes
            raise ParameterError(f"{self.folder}: {error.strerror or error}; {stays}") from None

    def table(self) -> pa.Table:
        """All rows, by number; what a flight has no figure for is null.

        A file that cannot be read holds none: its flights are missing.
        """
        parts = []
        for part in self._parts():
            with contextlib.suppress(pa.ArrowException, OSError):
                parts.append(pq.read_table(part))
        if not parts:
            return pa.table({NUMBER: pa.array([], pa.int64())})
        whole = pa.concat_tables(parts, promote_options="permissive")
        return whole.sort_by(NUMBER)

    def _parts(self) -> list[Path]:
        return sorted((self.folder / ROWS).glob("part-*.parquet"))

    @staticmethod
    def _write(path: Path, content: bytes) -> None:
        """Whole or not at all, also if the machine stops."""
        made = path.with_name(f".{path.name}.{os.getpid()}")
        try:
            with made.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            made.replace(path)
        finally:
            made.unlink(missing_ok=True)
