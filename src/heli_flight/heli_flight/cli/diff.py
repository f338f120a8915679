# SPDX-License-Identifier: Apache-2.0
"""`heli diff` on the command line."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from heli_flight.cli.options import Json

EPILOG = (
    "\b\nexample:\n  heli diff flights/before flights/after\n"
    "  heli diff soft close dear_angles --out three.html --json"
)


def diff(
    flights: Annotated[
        list[Path],
        typer.Argument(metavar="FLIGHT FLIGHT ...", help="folders of flights, or rosbag2 folders"),
    ],
    out: Annotated[
        Path, typer.Option(metavar="FILE", help="page to write; one that is there is replaced")
    ] = Path("diff.html"),
    as_json: Json = False,
) -> int:
    """Lay flights beside each other: parameters that differ, figures, charts in one page."""
    from heli_flight.report.diff import diff as compared
    from heli_flight.report.diff_page import print_diff, write_diff
    from heli_flight.terminal import amount, answer
    from heli_parameters.parameters import ParameterError

    if out.suffix != ".html":
        raise ParameterError(f"--out {out}: a page; its name must end in .html")
    with amount("flights read") as progress:
        found = compared(flights, progress)
    try:
        write_diff(found, out)
    except OSError as error:
        raise ParameterError(f"--out {out}: cannot be written: {error.strerror}") from None
    content = {**found.as_dict(), "page": str(out)}
    return answer(content, as_json, partial(print_diff, found), f"written: {out}")
