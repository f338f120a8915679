# SPDX-License-Identifier: Apache-2.0
"""Nodes started as launch would start them, until those that end last have ended."""

import contextlib
import subprocess


def flown(started, folder, env, *last):
    """Start nodes as launch does; exit codes of those that end last, and what all have said.

    Parameters
    ----------
    started : sequence
        What the fixture `launch` gives.
    folder : Path
        Gets their logs and parameter files.
    env : mapping
    *last : str
        Full names of nodes.
    """
    with contextlib.ExitStack() as ending:
        processes = {}
        for node in started:
            label = node.full_name.replace("/", "_")
            (folder / label).mkdir()
            log = ending.enter_context(open(folder / f"{label}.log", "wb"))
            processes[node.full_name] = subprocess.Popen(
                node.command(folder / label), env=env, stdout=log, stderr=subprocess.STDOUT
            )
            ending.callback(processes[node.full_name].terminate)
        codes = {processes[name].wait(timeout=240) for name in last}
    return codes, "".join(path.read_text() for path in folder.glob("*.log"))
