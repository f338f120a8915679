# SPDX-License-Identifier: Apache-2.0
"""The command `heli results`: the numbers that the READMEs publish, made, checked, rendered."""

from typing import Annotated

import typer

results = typer.Typer(
    help="Make, check and render the numbers that the READMEs publish.",
    no_args_is_help=True,
    rich_markup_mode=None,
    epilog="\b\nexample:\n  heli results make hover\n  heli results render",
)
Names = Annotated[
    list[str] | None, typer.Argument(metavar="NAMES", help="result files (default: all)")
]


@results.command("list", epilog="\b\nexample:\n  heli results list")
def list_results() -> int:
    """Say which command makes which result file."""
    from evidence.registry import chosen, load

    load()
    for producer in chosen([]):
        print(f"{producer.name}: {producer.what}\n    {producer.command}")
    return 0


@results.command("make", epilog="\b\nexample:\n  heli results make hover attitude")
def make_results(names: Names = None) -> int:
    """Run the commands and write docs/results/*.json, then render the tables."""
    from evidence import files, markdown
    from evidence.registry import chosen, load
    from heli_flight.terminal import console

    load()
    root, say = files.checkout(), console(stderr=True)
    files.refuse_changes(root)
    for producer in chosen(names or []):
        say.print(producer.command, soft_wrap=True)
        print(files.write(root, producer.name, files.make(root, producer)).relative_to(root))
    for path in markdown.render_all(root):
        print(path.relative_to(root))
    return 0


@results.command("render", epilog="\b\nexample:\n  heli results render")
def render_results() -> int:
    """Write the tables and numbers of the Markdown files from docs/results/*.json."""
    from evidence import files, markdown

    root = files.checkout()
    for path in markdown.render_all(root):
        print(path.relative_to(root))
    return 0


@results.command(
    "check",
    epilog="\b\nexample:\n  heli results check hover\n\n"
    "exit code: 0 as published, 1 a number differs, 2 bad input",
)
def check_results(names: Names = None) -> int:
    """Run the commands and compare what they say with docs/results/*.json."""
    from evidence import files
    from evidence.registry import chosen, load
    from heli_flight.terminal import console

    load()
    root, say, code = files.checkout(), console(stderr=True), 0
    for producer in chosen(names or []):
        say.print(producer.command, soft_wrap=True)
        stored = files.read(root, producer.name)
        changes = files.differences(stored, files.make(root, producer), producer)
        print(f"{producer.name}: " + ("as published" if not changes else f"{len(changes)} differ"))
        for line in changes:
            print(f"  {line}")
        code = max(code, int(bool(changes)))
    return code


def add_to(app: typer.Typer) -> None:
    """Give the command `heli` its sub-command `results`."""
    app.add_typer(results, name="results")
