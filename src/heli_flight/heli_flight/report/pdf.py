# SPDX-License-Identifier: Apache-2.0
"""A page as PDF, by a Chromium that is there already: it prints the page as a user would."""

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from heli_parameters.parameters import ParameterError

NAMES = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome",
    "microsoft-edge",
)  # fmt: skip
"""Programs that can print a page, in the order in which they are looked for on PATH."""
_LIMIT_S = 120.0
_FLAGS = (
    "--headless=new", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-quic", "--hide-scrollbars", "--no-pdf-header-footer",
)  # fmt: skip


def printer() -> str:
    """Path of a Chromium.

    Raises
    ------
    ParameterError
        There is none.
    """
    found = next(filter(None, map(shutil.which, NAMES)), None)
    if found is None:
        raise ParameterError(
            "--pdf: no Chromium on this machine to print with; install chromium or Google Chrome, "
            "or open report.html in a browser and print it"
        )
    return found


def write_pdf(page: Path, program: str) -> Path:
    """Print a page into a PDF beside it.

    Parameters
    ----------
    page : Path
    program : str
        As `printer` found it.

    Returns
    -------
    Path

    Raises
    ------
    ParameterError
        The program did not print it; with its last words.
    """
    pdf = page.resolve().with_suffix(".pdf")
    pdf.unlink(missing_ok=True)
    # Root has no sandbox in Chromium; the page is our own, and its policy lets nothing in or out.
    as_root = ("--no-sandbox",) if os.geteuid() == 0 else ()
    with tempfile.TemporaryDirectory() as profile:
        command = [program, *_FLAGS, *as_root, f"--user-data-dir={profile}"]
        command += [f"--print-to-pdf={pdf}", page.resolve().as_uri()]
        try:
            done = subprocess.run(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE, timeout=_LIMIT_S,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise ParameterError(f"--pdf: {program} did not print in {_LIMIT_S:g} s") from None
        except OSError as error:
            raise ParameterError(f"--pdf: {program}: {error.strerror}") from None
    if done.returncode or not pdf.is_file():
        lines = done.stderr.decode(errors="replace").strip().splitlines()
        why = f": {lines[-1]}" if lines else ""
        raise ParameterError(f"--pdf: {program} ended with {done.returncode}, no PDF{why}")
    return page.with_suffix(".pdf")
