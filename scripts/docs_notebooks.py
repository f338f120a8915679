# SPDX-License-Identifier: Apache-2.0
"""Pages that are made from notebooks: words, code, and what the code printed and drew."""

import base64
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

LINK = re.compile(r"(\]\([^)#\s]+)\.ipynb(?=[)#])")
"""A link to a notebook; on the site it leads to the notebook's page."""


def with_page_links(text: str) -> str:
    """Markdown whose links to notebooks lead to their pages."""
    return LINK.sub(r"\1.md", text)


def notebook_page(path: Path) -> tuple[str, dict[str, bytes]]:
    """A notebook as Markdown, and its pictures by file name.

    Parameters
    ----------
    path : Path
        A notebook with stored outputs, format 4.
    """
    book = json.loads(path.read_text(encoding="utf-8"))
    parts: list[str] = []
    pictures: dict[str, bytes] = {}
    for number, cell in enumerate(book["cells"], 1):
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
        elif cell["cell_type"] == "code":
            parts.append(f"```python\n{source}\n```")
            for output in cell["outputs"]:
                parts += _shown(output, f"{path.stem}_{number:02d}", pictures)
        if number == 1:
            parts.append(f"This page is [a notebook]({path.name}): [how to open it](README.md).")
    return "\n\n".join(parts) + "\n", pictures


def _shown(output: dict[str, Any], name: str, pictures: dict[str, bytes]) -> Iterator[str]:
    if output["output_type"] == "stream":
        yield f"```text\n{''.join(output['text']).rstrip()}\n```"
        return
    data = output.get("data", {})
    if "image/png" in data:
        file = f"{name}_{len(pictures):02d}.png"
        pictures[file] = base64.b64decode("".join(data["image/png"]))
        yield f"![What the cell above draws]({file})"
    elif "text/html" in data:
        yield "".join(data["text/html"])
    elif "text/plain" in data:
        yield f"```text\n{''.join(data['text/plain']).rstrip()}\n```"
