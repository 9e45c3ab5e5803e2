"""What is loaded from the cache is this user's own, whole, and under its own name; or nothing is loaded."""

import json
import os
import stat
import subprocess
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

from estimable import cache_folder
from estimable.commands import app
from estimable.engines import disk_cache, plain_format
from estimable.engines.llvm import compilation
from estimable.engines.llvm.scalar_loop import RowArray

CODE = """
import sys, os; os.umask(int(sys.argv[1], 8))
import numpy as np, estimable as es
model = es.StateSpace([[.9]], Q=[[1.]], R=[[1.]], dt=1)
result = es.estimate(es.Kalman(model), es.Record(np.ones(9), dt=1), prior=es.Prior([0.], [[1.]]))
print(result.engine, result.log_likelihood)
"""
posix = pytest.mark.skipif(not hasattr(os, "getuid"), reason="owners and modes are POSIX's")


def run(umask="022", **environment):
    """What a process of its own prints: the engine and the log-likelihood."""
    whole = {**os.environ, **environment}
    whole = {name: value for name, value in whole.items() if value is not None}
    done = subprocess.run([sys.executable, "-c", CODE, umask], env=whole, capture_output=True, text=True, check=True)
    return done.stdout, done.stderr


@pytest.fixture
def folder(tmp_path, monkeypatch):
    place = tmp_path / "cache"
    monkeypatch.setenv("ESTIMABLE_CACHE", str(place))
    monkeypatch.setattr(cache_folder, "_said", set())
    return place


def kept(words="words", content=b"content"):
    """Write an entry and read it back."""
    disk_cache.write(words, "o", content)
    return disk_cache.read(words, "o")


@posix
@pytest.mark.parametrize("umask", ["000", "022", "077"])
def test_the_folder_and_its_files_are_private(tmp_path, umask):
    place = tmp_path / "new" / "cache"
    first = run(umask, ESTIMABLE_CACHE=str(place))
    paths = [place.parent, place, *place.iterdir()]
    assert len(paths) > 4
    assert [path for path in paths if stat.S_IMODE(path.stat().st_mode) & 0o077] == []
    assert run(umask, ESTIMABLE_CACHE=str(place)) == first


@posix
@pytest.mark.parametrize("mode", [0o770, 0o707, 0o777, 0o1777])
def test_a_folder_in_which_others_may_write_is_not_used(folder, mode, caplog):
    assert kept() == b"content"
    folder.chmod(mode)
    for _ in range(2):
        assert disk_cache.read("words", "o") is None
        assert kept("new") is None
    ((message,),) = [[record.getMessage() for record in caplog.records if record.name == "estimable.cache"]]
    assert message == (
        f"The cache {folder} is not used: other users may write in it (mode {mode:o}). "
        "Machine code is compiled again in each process."
    )


@posix
def test_a_folder_below_one_in_which_others_may_write_is_not_used(folder):
    assert kept() == b"content"
    folder.parent.chmod(0o777)
    assert disk_cache.read("words", "o") is None
    folder.parent.chmod(0o1777)  # sticky: what lies in it is its owner's
    assert disk_cache.read("words", "o") == b"content"


@posix
def test_a_folder_of_another_user_is_not_used(folder, monkeypatch):
    assert kept() == b"content"
    mine = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: mine + 1)
    assert disk_cache.read("words", "o") is None
    assert "another user" in cache_folder.untrusted(folder)


@posix
def test_a_link_to_a_folder_is_not_used(folder, tmp_path):
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    folder.symlink_to(tmp_path / "elsewhere")
    assert kept() is None
    assert cache_folder.untrusted(folder) == "it is not a folder"


@posix
@pytest.mark.parametrize("mode", [0o620, 0o602])
def test_an_entry_in_which_others_may_write_is_not_loaded(folder, mode):
    assert kept() == b"content"
    (entry,) = folder.iterdir()
    entry.chmod(mode)
    assert disk_cache.read("words", "o") is None
    assert kept() == b"content"
    assert stat.S_IMODE(entry.stat().st_mode) == 0o600


@posix
def test_a_link_is_not_followed(folder, tmp_path):
    assert kept() == b"content"
    (entry,) = folder.iterdir()
    entry.rename(tmp_path / "moved")
    entry.symlink_to(tmp_path / "moved")
    assert disk_cache.read("words", "o") is None


def test_entries_that_changed_places_are_not_loaded(folder):
    kept("one", b"first"), kept("two", b"second")
    one, two = folder.iterdir()
    third = one.with_name("third")
    one.rename(third), two.rename(one), third.rename(two)
    assert disk_cache.read("one", "o") is None
    assert disk_cache.read("two", "o") is None


def test_every_damaged_byte_is_found(folder):
    assert kept() == b"content"
    (entry,) = folder.iterdir()
    whole = entry.read_bytes()
    for i in range(len(whole)):
        entry.write_bytes(whole[:i] + bytes([whole[i] ^ 1]) + whole[i + 1 :])
        assert disk_cache.read("words", "o") is None
    for length in range(len(whole)):
        entry.write_bytes(whole[:length])
        assert disk_cache.read("words", "o") is None


@pytest.mark.parametrize(
    ("environment", "reason"),
    [
        ({"ESTIMABLE_CACHE": "here"}, "its path is not absolute"),
        ({"ESTIMABLE_CACHE": None, "XDG_CACHE_HOME": "here"}, "its path is not absolute"),
        ({"ESTIMABLE_CACHE": "off"}, None),
        ({"ESTIMABLE_CACHE": os.devnull}, "it is not a folder"),
        ({"ESTIMABLE_CACHE": os.devnull + "/below"}, "Not a directory"),
    ],
)
def test_without_a_folder_that_can_be_trusted_there_is_no_cache(environment, reason, tmp_path, monkeypatch, caplog):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cache_folder, "_said", set())
    for name, value in environment.items():
        monkeypatch.setenv(name, value) if value else monkeypatch.delenv(name, raising=False)
    assert kept() is None
    assert list(tmp_path.iterdir()) == []
    said = [record.getMessage() for record in caplog.records if record.name == "estimable.cache"]
    assert len(said) == (reason is not None)
    assert all(reason in sentence for sentence in said)


def test_without_a_home_there_is_no_cache(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("ESTIMABLE_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)
    assert cache_folder.folder() is None
    assert kept() is None
    assert list(tmp_path.iterdir()) == []


def test_the_entries_used_least_lately_are_deleted_first(folder):
    for i in range(10):
        kept(str(i), bytes(1000))
        name = disk_cache._file(str(i), "o")
        os.utime(folder / name, (i, i))
    disk_cache.read("0", "o")
    cache_folder.tidy(folder, most=6000)
    left = [i for i in range(10) if disk_cache.read(str(i), "o") is not None]
    assert left == [0, 7, 8, 9]


def test_a_cache_is_cleared(folder):
    kept("one"), kept("two")
    assert cache_folder.clear() == (folder, 2)
    assert disk_cache.read("one", "o") is None
    assert cache_folder.clear() == (folder, 0)


@posix
def test_a_full_disk_is_no_error(tmp_path):
    place = tmp_path / "cache"
    limit = (
        "import resource, signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN);"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (99, 99))"
    )
    done = subprocess.run(
        [sys.executable, "-c", limit + CODE, "022"], env={**os.environ, "ESTIMABLE_CACHE": str(place)},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.startswith("native")
    assert list(place.iterdir()) == []


@pytest.mark.parametrize(
    "text",
    [
        b'{"posix:system":["true"]}', b'{"estimable.engines.disk_cache:os.system":["true"]}',
        b'{"estimable.store.load:load":["x"]}', b'{"estimable.engines.choice:jax.jit":[1]}', b'{"a":1,"b":2}', b"[1", b"\xff",
        b'{"tuple":5}', b'{"rows":["estimable.engines.program.straight_line:Program",5]}',
        b'{"enum":["os:path","join"]}', b'{"array":["O",[1],[1]]}',
    ],
)  # fmt: skip
def test_nothing_in_an_entry_can_run(text):
    with pytest.raises(ValueError, match="the text is not a record of the operations of a step"):
        plain_format.loads(text)


def test_values_come_back_as_they_were():
    values = [None, True, 0, 1, -0.0, 1e-320, float("inf"), 2**200, "α", (), (1, (2.0, "x")), [1, [2]], {"a": (1,), 2: None},
              np.arange(6).reshape(2, 3), np.array([0.1, -0.0]), np.array(True), np.dtype("int32"), np.float64(0.1), np.int64(3),
              (RowArray((1, 2)), RowArray((), "i8"))]  # fmt: skip
    for value in values:
        again = plain_format.loads(plain_format.dumps(value))
        assert type(again) is type(value)
        assert repr(again) == repr(value)
    (nan,) = plain_format.loads(plain_format.dumps((float("nan"),)))
    assert nan != nan
    with pytest.raises(TypeError, match="has no plain form"):
        plain_format.dumps(compilation.Compiled)


def invoked(*arguments):
    result = CliRunner().invoke(app, ["cache", *arguments])
    assert result.exit_code == 0
    return result.stdout


def test_the_command_says_where_the_cache_is_and_clears_it(folder):
    kept("one"), kept("two")
    assert invoked("--where").split() == str(folder).split()
    assert "2 entries, 0.0 MiB (at most 500 MiB)." in invoked()
    assert json.loads(invoked("--json"))["entries"] == 2
    assert "2 entries deleted." in invoked("--clear")
    assert json.loads(invoked("--json")) | {"version": ""} == {
        "command": "cache", "version": "", "outcome": {"code": 0, "sentence": ""}, "folder": str(folder), "entries": 0,
        "bytes": 0, "deleted": 0,
    }  # fmt: skip


def test_the_command_says_that_there_is_no_cache(monkeypatch):
    monkeypatch.setenv("ESTIMABLE_CACHE", "off")
    assert invoked() == "There is no cache: the machine code is compiled again in each process.\n"
    assert json.loads(invoked("--json"))["folder"] is None
