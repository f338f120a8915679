# SPDX-License-Identifier: Apache-2.0
"""What set-up downloads and takes of the disk, by the files that are pinned.

`scripts/setup_size.py` measures it.
"""

from evidence.registry import produces

produces(
    "setup_size",
    "./heli python scripts/setup_size.py",
    "What set-up downloads and takes of the disk, by the files that are pinned.",
    loose={
        **{f"{name}_mb": 0.2 for name in ("download", "flight", "uv", "test", "disk", "test_disk")},
        **{f"{name}_files": 0.1 for name in ("flight", "uv", "test")},
    },
)
