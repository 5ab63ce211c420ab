"""What is kept on disk is right, or it is not used: entries, folders and files that were changed, damaged,
or written by others."""

import os
import pickle
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mbdae import disk
from mbdae.disk import HASH, PART, SUFFIX, Store, entries

KEY, OTHER = "a" * 64, "b" * 64
POSIX = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="rights of files as on Unix")


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "kept")


def file_of(store, key=KEY):
    return store.folder / (key + SUFFIX)


def test_an_entry_is_read_as_written_by_another_process(store):
    store.write(KEY, b"content")
    assert Store(store.folder).read(KEY) == b"content"
    assert store.read(OTHER) is None
    assert (store.hits, store.misses) == (0, 1)


@POSIX
def test_folder_and_files_are_for_their_owner_alone(store):
    store.write(KEY, b"content")
    assert stat.S_IMODE(store.folder.stat().st_mode) == 0o700
    assert stat.S_IMODE(file_of(store).stat().st_mode) == 0o600


@pytest.mark.parametrize("change", [
    lambda whole: whole[:-1], lambda whole: b"", lambda whole: whole[:HASH], lambda whole: whole + b"x",
    lambda whole: whole[:HASH] + b"CONTENT", lambda whole: b"\0" * HASH + whole[HASH:],
])
def test_damaged_entries_are_removed(store, change):
    store.write(KEY, b"content")
    file_of(store).write_bytes(change(file_of(store).read_bytes()))
    assert store.read(KEY) is None
    assert not file_of(store).exists()
    store.write(KEY, b"content")
    assert store.read(KEY) == b"content"


def test_a_file_under_another_name_is_no_entry(store):
    store.write(KEY, b"content")
    os.rename(file_of(store), file_of(store, OTHER))
    assert store.read(OTHER) is None


@POSIX
@pytest.mark.parametrize("mode", [0o755, 0o770, 0o701, 0o722])
def test_a_folder_that_others_may_enter_is_not_used(store, mode):
    store.write(KEY, b"content")
    store.folder.chmod(mode)
    again = Store(store.folder)
    assert not again.used
    assert "others" in again.why
    assert again.read(KEY) is None
    again.write(OTHER, b"content")
    assert not file_of(store, OTHER).exists()


@POSIX
@pytest.mark.parametrize("mode", [0o644, 0o660, 0o602])
def test_a_file_on_which_others_have_rights_is_not_read(store, mode):
    store.write(KEY, b"content")
    file_of(store).chmod(mode)
    assert store.read(KEY) is None


@POSIX
def test_what_belongs_to_another_user_is_not_read(store, monkeypatch):
    store.write(KEY, b"content")
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    assert store.read(KEY) is None
    assert "another user" in Store(store.folder).why


@POSIX
def test_links_are_not_followed(store, tmp_path):
    store.write(KEY, b"content")
    os.rename(file_of(store), tmp_path / "elsewhere")
    os.symlink(tmp_path / "elsewhere", file_of(store))
    assert store.read(KEY) is None
    os.symlink(store.folder, tmp_path / "link")
    assert "no folder" in Store(tmp_path / "link").why


MADE = {"pipe": os.mkfifo, "folder": os.mkdir, "circle": lambda path: os.symlink(path, path),
        "device": lambda path: os.symlink("/dev/zero", path)} if hasattr(os, "mkfifo") else {}


@POSIX
@pytest.mark.parametrize("kind", MADE)
def test_what_is_no_file_is_not_read_and_stops_nothing(tmp_path, kind):
    """A pipe would wait for another process for ever: everything is done in a process of its own that has 20 s."""
    folder = Store(tmp_path / "kept").folder
    for name in (KEY + SUFFIX, "counts", f"old{PART}"):
        MADE[kind](folder / name)
    code = """
import sys
from pathlib import Path
from mbdae.disk import Store
store = Store(Path(sys.argv[1]))
print(store.content())
print(store.read(sys.argv[2]))
for key in sys.argv[2:]:
    store.write(key, b"content")
print(store.read(sys.argv[3]))
store.content()
"""
    run = subprocess.run([sys.executable, "-c", code, str(folder), KEY, OTHER], timeout=20, check=False, capture_output=True,
                         text=True)
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout.splitlines() == ["Content(entries=0, size=0, hits=0, misses=0)", "None", "b'content'"]
    assert Store(folder).read(KEY) == (None if kind == "folder" else b"content")
    assert Store(folder).clear() == (1 if kind == "folder" else 2)


@POSIX
@pytest.mark.parametrize("kind", MADE)
def test_a_folder_that_is_none_is_not_used(tmp_path, kind):
    MADE[kind](tmp_path / "kept")
    for place_ in (tmp_path / "kept", tmp_path / "kept" / "below")[kind == "folder" :]:
        assert Store(place_).used is (kind == "folder")


def test_open_files_are_closed_where_they_are_none(store):
    file_of(store).mkdir()
    before = len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else 0
    for _ in range(5):
        assert store.read(KEY) is None
    assert before in (0, len(os.listdir("/proc/self/fd")))


def test_a_full_disk_ends_keeping_and_nothing_else(store, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    store.write(KEY, b"content")
    monkeypatch.setattr(os, "replace", full)
    store.write(OTHER, b"content")
    monkeypatch.undo()
    assert store.read(OTHER) is None
    assert not list(store.folder.glob(f"*{PART}"))
    assert store.read(KEY) == b"content"


def test_a_folder_that_cannot_be_made_is_not_used(tmp_path):
    (tmp_path / "file").write_text("in the way")
    assert not Store(tmp_path / "file").used
    assert not Store(tmp_path / "file" / "below").used
    assert Store(None).read(KEY) is None


def test_the_least_recently_used_go_first(tmp_path):
    store = Store(tmp_path / "kept", limit=10_000)
    for i in range(9):
        store.write(f"{i:064}", bytes(1000))
        os.utime(file_of(store, f"{i:064}"), (1000.0 + i, 1000.0 + i))
    assert store.read(f"{0:064}") is not None  # a use, which makes it the youngest
    store.write(f"{9:064}", bytes(1000))
    left = {int(path.stem) for path in store.folder.glob(f"*{SUFFIX}")}
    assert store.content().size <= 10_000
    assert {0, 9} <= left
    assert 1 not in left
    store.write(KEY, bytes(20_000))  # larger than all that may be kept
    assert store.read(KEY) is None


def test_what_interrupted_writing_left_is_removed(store):
    old, new = store.folder / f"old{PART}", store.folder / f"new{PART}"
    old.write_bytes(b"")
    new.write_bytes(b"")
    os.utime(old, (time.time() - 7200,) * 2)
    store.write(KEY, b"content")
    assert (old.exists(), new.exists()) == (False, True)


def test_processes_that_write_at_once_leave_whole_entries(store):
    code = """
import sys
from pathlib import Path
from mbdae.disk import Store
store = Store(Path(sys.argv[1]))
for n in range(300):
    key = f"{n % 7:064}"
    store.write(key, key.encode() * 999)
    found = store.read(key)
    assert found in (None, key.encode() * 999)
    if n % 50 == 0:
        store.clear()
"""
    runs = [subprocess.Popen([sys.executable, "-c", code, str(store.folder)]) for _ in range(3)]
    assert [run.wait() for run in runs] == [0, 0, 0]
    for n in range(7):
        assert store.read(f"{n:064}") in (None, f"{n:064}".encode() * 999)
    assert not list(store.folder.glob(f"*{PART}"))


def test_counts_of_all_processes_are_added(store):
    for _ in range(2):
        one = Store(store.folder)
        one.write(KEY, b"content")
        one.read(KEY)
        one.read(OTHER)
        one._count()
    assert store.content()[2:] == (2, 2)
    assert store.clear() == 1
    assert store.content() == (0, 0, 0, 0)


def test_entries_are_few_enough_to_look_through(store, monkeypatch):
    monkeypatch.setattr("mbdae.disk.MOST", 10)
    for i in range(30):
        store.write(f"{i:064x}", b"content")
        os.utime(file_of(store, f"{i:064x}"), (i, i))
        assert store.content().entries <= 10
    assert store.read(f"{29:064x}") == b"content"
    assert Store(store.folder).read(f"{0:064x}") is None


def test_counts_go_on_after_their_file_was_shortened(store):
    for _ in range(2):
        store.read(KEY)
        store._count()
        store._shorten()
    assert store.content().misses == 3  # the second process of a store counts all that it missed

@pytest.mark.parametrize(("variables", "found"), [
    ({"MBDAE_CACHE": "off"}, None), ({"MBDAE_CACHE": "OFF"}, None), ({"MBDAE_CACHE": "/a/b"}, "/a/b"),
    ({"MBDAE_CACHE": "~/a", "HOME": "/h"}, "/h/a"), ({"MBDAE_CACHE": "~", "HOME": "/h"}, "/h"),
    ({"MBDAE_CACHE": "~nobody-of-this-name/a"}, None),
    ({"XDG_CACHE_HOME": "/x"}, "/x/mbdae"), ({"XDG_CACHE_HOME": "relative", "HOME": "/h"}, "/h/.cache/mbdae"),
    ({"HOME": "/h"}, "/h/.cache/mbdae"),
])
def test_where_entries_are(monkeypatch, variables, found):
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("MBDAE_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert disk.chosen_folder()[0] == (None if found is None else Path(found))


def test_the_folders_of_other_systems(monkeypatch):
    monkeypatch.delenv("MBDAE_CACHE")
    monkeypatch.setenv("HOME", "/h")
    monkeypatch.setattr(sys, "platform", "darwin")
    assert disk.chosen_folder()[0] == Path("/h/Library/Caches/mbdae")
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setenv("LOCALAPPDATA", "/local")
    assert disk.chosen_folder()[0] == Path("/local/mbdae/Cache")


class _Bad:
    def __reduce__(self):
        return os.mkdir, ("made by an entry",)


def test_an_entry_calls_nothing(store, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(entries, "store", lambda: store)
    store.write(KEY, pickle.dumps(_Bad()))
    assert entries.recall(KEY) is None
    assert not (tmp_path / "made by an entry").exists()
    assert not file_of(store).exists()
