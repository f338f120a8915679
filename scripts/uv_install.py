#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Become `uv pip install`, with the settings that this interpreter's pip has.

    python3 uv_install.py UV ARGUMENT...

uv does not read pip's configuration (pip.conf, PIP_* variables). Where somebody's wheels come from
a mirror, from a folder or through a proxy, uv is told so by its own variables; those that are set
already are left alone.
"""

import ast
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

# pip's option -> uv's variables. pip separates several values by blanks or new lines.
VARIABLES = {
    "index-url": ("UV_DEFAULT_INDEX",),
    "extra-index-url": ("UV_INDEX",),
    "find-links": ("UV_FIND_LINKS",),
    "trusted-host": ("UV_INSECURE_HOST",),
    "cert": ("SSL_CERT_FILE",),
    "client-cert": ("SSL_CLIENT_CERT",),
    "proxy": ("HTTP_PROXY", "HTTPS_PROXY"),
    "timeout": ("UV_HTTP_TIMEOUT",),
    "default-timeout": ("UV_HTTP_TIMEOUT",),
}
SEPARATORS = {"find-links": ","}
# Sections of pip's configuration that speak of `pip install`; a later one counts more.
SECTIONS = ("global", "install", ":env:")


def pip_options(listed: str) -> dict[str, str]:
    """Options of `pip install` in the output of `pip config list`."""
    found: dict[str, dict[str, str]] = {section: {} for section in SECTIONS}
    for line in listed.splitlines():
        key, separator, value = line.partition("=")
        section, _, name = key.partition(".")
        if separator and section in found:
            found[section][name.replace("_", "-")] = ast.literal_eval(value)
    return found["global"] | found["install"] | found[":env:"]


def uv_variables(options: Mapping[str, str]) -> dict[str, str]:
    """uv's variables that say what pip's options say."""
    variables = {}
    for name, value in options.items():
        for variable in VARIABLES.get(name, ()):
            variables[variable] = SEPARATORS.get(name, " ").join(value.split())
    if "extra-index-url" in options:
        # As pip does: all indexes are of the same rank.
        variables["UV_INDEX_STRATEGY"] = "unsafe-best-match"
    return variables


def uv_arguments(options: Mapping[str, str]) -> list[str]:
    """What of pip's options uv has no variable for."""
    wanted = options.get("no-index", "").lower() in ("1", "true", "yes", "on", "y", "t")
    return ["--no-index"] if wanted else []


def cache_variables(environment: Mapping[str, str]) -> dict[str, str]:
    """Have uv do without a cache where it cannot write one (no home, or one that is read-only)."""
    if "UV_CACHE_DIR" in environment or "UV_NO_CACHE" in environment:
        return {}
    try:
        folder = Path(environment.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "uv"
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except (OSError, RuntimeError):
        return {"UV_NO_CACHE": "1"}
    return {}


def main() -> int:
    """Replace this process by uv; returns only if that is not possible."""
    uv, *arguments = sys.argv[1:]
    command = [sys.executable, "-m", "pip", "config", "list"]
    listed = subprocess.run(command, capture_output=True, text=True)
    options = pip_options(listed.stdout) if listed.returncode == 0 else {}
    if "UV_INDEX_URL" in os.environ:  # uv's older name of the same
        options.pop("index-url", None)
    environment = uv_variables(options) | cache_variables(os.environ) | dict(os.environ)
    try:
        os.execve(uv, [uv, "pip", "install", *uv_arguments(options), *arguments], environment)
    except OSError as error:
        print(f"{uv}: {error.strerror}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
