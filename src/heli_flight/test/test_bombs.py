# SPDX-License-Identifier: Apache-2.0
"""Small files that ask for much: each reader takes or refuses them, in a sentence, in 512 MB.

The table of readers and bombs is `support.bombs`; it is read in processes of their own, whose
memory is measured for each pair.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from rosbags.rosbag2 import storage_mcap

from heli_bags import bag_files
from heli_core.foreign_files import BUDGET_VARIABLE
from support import bombs
from support.fuzzing import is_sentence

MOST_MB, MOST_CPU_S = 512, 10
# What is known of a bag by its index alone, or put right, is no refusal.
MAY_TAKE = ("bag info", "bag repair")


def met(folder, *groups):
    script = Path(bombs.__file__)
    words = [sys.executable, str(script), str(folder), *groups]
    quiet = {key: value for key, value in os.environ.items() if key != BUDGET_VARIABLE}
    done = subprocess.run(words, capture_output=True, text=True, env=quiet, timeout=280)
    assert done.returncode == 0, done.stderr[-2000:]
    return [bombs.Met(**json.loads(line)) for line in done.stdout.splitlines() if line[:1] == "{"]


def judge(rows, groups):
    wanted = {
        (reader, bomb)
        for name in groups
        for reader in bombs.GROUPS[name].readers
        for bomb in bombs.GROUPS[name].bombs()
    }
    assert {(row.reader, row.bomb) for row in rows} == wanted
    for row in rows:
        assert row.peak_mb < MOST_MB and row.cpu_s < MOST_CPU_S, row
        assert not row.wrong, row
        assert is_sentence(row.refused) or (row.reader in MAY_TAKE and not row.refused), row
    refused = {row.bomb for row in rows if row.refused}
    assert refused == {bomb for _, bomb in wanted}


@pytest.mark.slow
def test_a_small_file_does_not_take_the_memory(tmp_path):
    groups = ("yaml", "json", "arrays", "sums", "bags")
    judge(met(tmp_path, *groups), groups)


@pytest.mark.slow
def test_nor_does_it_in_what_reads_a_whole_bag(tmp_path):
    groups = ("bags in full",)
    judge(met(tmp_path, *groups), groups)


def test_the_library_s_readers_ask_the_budget():
    """They have no parameter for it: what stands in front of them is put in by name."""
    assert set(storage_mcap.DECOMPRESSORS) == {"", "lz4", "zstd"}
    for expand in storage_mcap.DECOMPRESSORS.values():
        assert expand.__module__ == bag_files.__name__
    for name in ("parse_qos", "get_msgdef", "read_string"):
        assert getattr(storage_mcap, name).__module__ == bag_files.__name__
