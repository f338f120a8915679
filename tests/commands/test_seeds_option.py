# SPDX-License-Identifier: Apache-2.0
"""What scripts of results share: seeds that are none are refused."""

import pytest

from evidence import options


def test_seeds_that_are_none_are_refused_in_a_sentence(capsys):
    with pytest.raises(SystemExit) as refused:
        options.parser_with_seeds("What.").parse_args(["--seeds", "5..2"])
    assert refused.value.code == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert "--seeds: 5..2: " in line and line.endswith(" 1..20, 7, 1,5,9 or 1..20,31..40")
