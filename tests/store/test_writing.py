"""Files are written whole, or not at all."""

import errno
import os
import stat

import pytest

from estimable import InputError, Prior, load, save
from estimable.writing import write


def refusal(path, fill=lambda stream: stream.write(b"new")):
    with pytest.raises(InputError) as caught:
        write(path, fill)
    return str(caught.value)


def full(*_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_new_file_takes_the_name_when_it_is_whole(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"old")

    def fill(stream):
        stream.write(b"new")
        stream.flush()
        assert path.read_bytes() == b"old"

    write(path, fill)
    assert path.read_bytes() == b"new"
    assert os.listdir(tmp_path) == ["file"]


@pytest.mark.parametrize("name", ["fsync", "replace"])
def test_an_older_file_stays_where_the_disk_is_full(tmp_path, monkeypatch, name):
    path = tmp_path / "file"
    path.write_bytes(b"old")
    monkeypatch.setattr(os, name, full)
    assert refusal(path) == f"{path} could not be written: No space left on device."
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["file"]


def test_an_older_file_stays_where_writing_is_stopped(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"old")

    def stopped(stream):
        stream.write(b"ne")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write(path, stopped)
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["file"]


def test_permissions_stay_and_those_of_a_new_file_are_as_usual(tmp_path):
    old, new = tmp_path / "old", tmp_path / "new"
    old.write_bytes(b"old")
    old.chmod(0o640)
    for path in (old, new):
        write(path, lambda stream: stream.write(b"new"))
    (tmp_path / "usual").write_bytes(b"")
    assert stat.S_IMODE(old.stat().st_mode) == 0o640
    assert new.stat().st_mode == (tmp_path / "usual").stat().st_mode


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "there").mkdir()
    path, link = tmp_path / "there" / "file", tmp_path / "link"
    link.symlink_to(path)
    for text in (b"one", b"two"):
        write(link, lambda stream, text=text: stream.write(text))
        assert link.is_symlink()
        assert path.read_bytes() == text


def test_a_read_only_file_is_not_replaced(tmp_path, monkeypatch):
    path = tmp_path / "file"
    path.write_bytes(b"old")
    monkeypatch.setattr(os, "access", lambda *_: False)  # the superuser may write to every file
    assert refusal(path) == f"{path} could not be written: the file is read-only."
    assert path.read_bytes() == b"old"


def test_a_device_is_written_and_stays():
    write("/dev/null", lambda stream: stream.write(b"new"))
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)
    assert refusal("/dev/full") == "/dev/full could not be written: No space left on device."


@pytest.mark.parametrize("path", [None, 3, b"name", "a\0b"])
def test_a_path_must_be_a_name(path):
    assert refusal(path) == f"`path` must be the name of a file. Got {path!r}."


def test_a_folder_is_no_file_and_must_be_there(tmp_path):
    assert refusal(tmp_path) == f"{tmp_path} could not be written: it is a folder."
    assert (
        refusal(tmp_path / "none" / "file")
        == f"{tmp_path / 'none' / 'file'} could not be written: No such file or directory."
    )


def test_save_writes_so(tmp_path, monkeypatch):
    path = tmp_path / "prior.npz"
    save(path, Prior([1.0], [[1.0]]))
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match="No space left on device"):
        save(path, Prior([2.0], [[1.0]]))
    assert load(path).mean.tolist() == [1.0]
