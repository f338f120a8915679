# SPDX-License-Identifier: Apache-2.0
"""Whatever TMPDIR is, a flight flies, and leaves nothing in it."""


def test_a_flight_with_a_long_tmpdir_leaves_nothing_there(hover_test, tmp_path):
    """Too long for the path of a Unix socket, which has 107 bytes at most."""
    folder = tmp_path / ("t" * 120)
    folder.mkdir()
    out = tmp_path / "flight"
    env = {"TMPDIR": str(folder), "ROS_DOMAIN_ID": ""}
    done = hover_test("--duration", "2", "--out", out, env=env)
    assert done.returncode == 0, done.stdout + done.stderr
    assert (out / "result.json").is_file()
    assert list(folder.iterdir()) == []
