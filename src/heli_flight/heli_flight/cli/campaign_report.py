# SPDX-License-Identifier: Apache-2.0
"""The command `heli campaign report`: one page of a campaign's folder."""

import os
from pathlib import Path
from typing import Annotated

import typer

from heli_flight.cli.options import Json

REPORT_EPILOG = (
    "\b\nexample:\n  heli campaign report flown\n\n"
    "exit code: 0 written, 2 bad input. A campaign that was broken off is told as far as it came."
)


def campaign_report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="the --out of a campaign")],
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="folder to write (default: the campaign's own)"),
    ] = None,
    as_json: Json = False,
) -> int:
    """Write report.html and figures of a campaign: distributions, causes, what explains them."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from heli_flight.studies.dispersion.report import STEPS, as_dict, write_page
    from heli_flight.studies.dispersion.told import read_campaign
    from heli_flight.terminal import json_text, steps

    with steps("report", STEPS) as progress:
        told = read_campaign(folder)
        page = write_page(told, out or folder, progress)
    if as_json:
        print(json_text(as_dict(told, page)), end="")
        return 0
    print(f"written: {page}")
    return 0
