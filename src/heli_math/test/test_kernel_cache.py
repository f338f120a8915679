# SPDX-License-Identifier: Apache-2.0
"""A changed source file of any kernel starts a fresh cache; nodes and tables do not."""

import pytest

from heli_math import jit


@pytest.mark.parametrize(
    ("package", "name", "content", "expected"),
    [
        ("heli_dynamics_sim", "state.py", b"STEP_S = 0.002", True),  # a constant is compiled in
        ("heli_dynamics_sim", "rotor.py", b"@njit", True),
        ("heli_dynamics_sim", "node.py", b"import rclpy", False),
        ("heli_msgs_bridge", "recorder_node.py", b"", False),
        ("heli_outer_pd", "parameter_table.py", b"TABLE", False),
        ("heli_hover_test", "result.py", b"print", False),
        ("heli_hover_test", "closed_loop.py", b"@njit", True),
    ],
)
def test_what_bears_on_kernels(package, name, content, expected):
    assert jit._bears_on_kernels(package, name, content) is expected


def test_digest_follows_the_content(tmp_path, monkeypatch):
    folder = tmp_path / "heli_math_probe"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "constants.py").write_text("A = 1\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(jit, "KERNEL_PACKAGES", ("heli_math_probe",))
    before = jit._source_digest()
    assert jit._source_digest() == before
    (folder / "constants.py").write_text("A = 2\n")
    assert jit._source_digest() != before
