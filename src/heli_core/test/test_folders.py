# SPDX-License-Identifier: Apache-2.0
"""Folders that are this user's alone, where others could have been first."""

import errno
import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from heli_core import folders

CODE = "from heli_core.jit import cache_root; print(cache_root())"
NO_ENVIRONMENT = "import sys; sys.prefix = sys.base_prefix; "


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    monkeypatch.setattr(folders.tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(folders.atexit, "register", lambda remove: remove)
    monkeypatch.setenv("HELI_PRIVATE_FOLDER", "")
    folders._fresh.cache_clear()
    yield tmp_path
    folders._fresh.cache_clear()


def mode(path):
    return stat.S_IMODE(os.stat(path).st_mode)


def test_it_is_made_for_this_user_alone_and_found_again(temporary):
    folder = folders.temporary_folder("kernels")
    assert folder == temporary / f"heli_hover-{os.getuid()}" / "kernels"
    assert mode(folder) == mode(folder.parent) == 0o700
    assert folders.temporary_folder("kernels") == folder


def test_what_others_could_write_to_is_closed_to_them(temporary):
    place = temporary / f"heli_hover-{os.getuid()}"
    place.mkdir()
    place.chmod(0o777)
    assert folders.temporary_folder("kernels").parent == place
    assert mode(place) == 0o755


def plant(place, how, elsewhere):
    if how == "link":
        place.symlink_to(elsewhere)
    elif how == "fifo":
        os.mkfifo(place)
    elif how == "file":
        place.touch()
    else:
        if os.getuid():
            pytest.skip("to give a folder to another user needs root")
        place.mkdir()
        os.chown(place, 65534, 65534)


@pytest.mark.parametrize("how", ["link", "fifo", "file", "another user's"])
@pytest.mark.parametrize("inside", [False, True], ids=["the folder", "one in it"])
def test_what_somebody_else_put_there_is_not_used(temporary, how, inside):
    elsewhere = temporary / "elsewhere"
    elsewhere.mkdir()
    place = temporary / f"heli_hover-{os.getuid()}"
    if inside:
        place.mkdir(0o700)
        place = place / "kernels"
    plant(place, how, elsewhere)
    folder = folders.temporary_folder("kernels")
    assert place not in (folder, *folder.parents) and mode(folder) == 0o700
    assert folders.temporary_folder("kernels") == folder
    assert os.environ["HELI_PRIVATE_FOLDER"] == str(folder.parent)
    assert not list(elsewhere.iterdir())


def test_kernels_are_not_read_from_a_folder_behind_a_link(tmp_path):
    """Where there is no home, and somebody knew the name of the folder that would serve."""
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (tmp_path / f"heli_hover-{os.getuid()}").symlink_to(elsewhere)
    env = {**os.environ, "TMPDIR": str(tmp_path), "HOME": "/proc/nowhere"}
    env |= {"XDG_CACHE_HOME": "", "HELI_KERNEL_CACHE": ""}
    done = subprocess.run(
        [sys.executable, "-c", NO_ENVIRONMENT + CODE],
        env=env,
        capture_output=True,
        text=True,
        check=True,
    )
    root = Path(done.stdout.strip())
    assert root.parent.parent == tmp_path and elsewhere not in root.resolve().parents
    assert not root.exists(), "a fresh folder goes with its process"


def test_a_cache_that_others_made_is_not_read(tmp_path):
    """A cache folder of the user's own choice, in which another was first: the next serves."""
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "heli_hover").symlink_to(tmp_path / "elsewhere")
    env = {**os.environ, "TMPDIR": str(tmp_path), "HELI_KERNEL_CACHE": str(tmp_path)}
    env |= {"HOME": "", "XDG_CACHE_HOME": ""}
    done = subprocess.run(
        [sys.executable, "-c", NO_ENVIRONMENT + CODE],
        env=env,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.startswith(str(tmp_path / f"heli_hover-{os.getuid()}"))


def test_a_cache_in_a_folder_that_others_may_write_to_is_not_read(tmp_path):
    """Whoever may rename what lies there may put his own in its place; a sticky one lets nobody."""
    shared, place = tmp_path / "shared", tmp_path / f"heli_hover-{os.getuid()}"
    (shared / "cache").mkdir(parents=True)
    for rights, used in ((0o777, False), (0o1777, True), (0o755, True)):
        for folder in (shared, shared / "cache"):
            folder.chmod(rights)
            env = {
                **os.environ, "TMPDIR": str(tmp_path), "HELI_KERNEL_CACHE": str(shared / "cache"),
                "HOME": "", "XDG_CACHE_HOME": "",
            }  # fmt: skip
            done = subprocess.run(
                [sys.executable, "-c", NO_ENVIRONMENT + CODE],
                env=env,
                capture_output=True,
                text=True,
                check=True,
            )
            assert done.stdout.startswith(str(shared if used else place)), oct(rights)
            folder.chmod(0o755)


@pytest.fixture
def full(monkeypatch):
    """A disk that takes half of what is written."""

    def write_bytes(path, raw):
        with open(path, "wb") as file:
            file.write(raw[: len(raw) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", write_bytes)


def test_on_a_full_disk_a_file_stays_what_it_was(full, tmp_path):
    page = tmp_path / "report.html"
    for before in (None, "what was"):
        if before is not None:
            page.write_text(before)
        with pytest.raises(OSError, match="report.html") as refused:
            folders.write_whole(page, "what is to be")
        assert refused.value.errno == errno.ENOSPC
        assert page.exists() == (before is not None)
        assert {path.name for path in tmp_path.iterdir()} == ({page.name} if before else set())
    assert page.read_text() == "what was"


def test_a_file_is_written_whole_also_behind_a_link_and_into_a_device(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    link = tmp_path / "page.html"
    link.symlink_to(tmp_path / "elsewhere" / "page.html")
    folders.write_whole(link, "a page")
    assert link.is_symlink() and link.read_text() == "a page"
    folders.write_whole(Path("/dev/null"), b"nothing")
    assert not Path("/dev/null").is_file()
