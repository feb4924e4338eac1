"""A results store at a URL: what a local one does, without renaming, and whatever breaks off."""

import sys
from pathlib import Path

import fsspec
import pytest
from fsspec.implementations.dirfs import DirFileSystem

from motord.results.error import ResultsError
from motord.results.folders import remote_folder
from motord.results.folders.remote_folder import PROBE, RemoteFolder
from motord.results.store import ResultsStore
from tests.unit.results.buckets import BUCKET, SHOWN, URL, NoCredentials, bucket, failing
from tests.unit.results.made_up import fill, result

FULL = OSError(28, "No space left on device")
NO_BUCKET = FileNotFoundError("The specified bucket does not exist")
DENIED = PermissionError("Access Denied")
DROPPED = ConnectionResetError("Connection reset by peer")
SILENT = TimeoutError()
NO_LOGIN = NoCredentials("Unable to locate\ncredentials")


@pytest.fixture(params=["memory", "bucket", "file", "local by fsspec", "dirfs"])
def place(request, tmp_path, monkeypatch):
    """A place for a store."""
    if request.param == "memory":
        memory = fsspec.filesystem("memory")
        monkeypatch.setattr(memory, "store", {})
        return f"memory://{BUCKET}/line 1"
    if request.param == "bucket":
        bucket()
        return URL
    if request.param == "file":
        return (tmp_path / "line 1").as_uri()
    (tmp_path / "store").mkdir()
    local = fsspec.filesystem("file")
    files = DirFileSystem(path=str(tmp_path), fs=local) if request.param == "dirfs" else local
    root = "store" if request.param == "dirfs" else str(tmp_path / "store")
    opened = RemoteFolder(files, root, "test://store")
    monkeypatch.setattr(remote_folder, "open_remote", lambda url: opened)
    return "test://store"


def test_what_is_stored_is_read_as_from_a_local_folder(place, tmp_path):
    local = fill(tmp_path / "local", [0.8, 0.1 + 0.2, 0.9], serial="Ø 7/1")
    store = fill(place, [0.8, 0.1 + 0.2, 0.9], serial="Ø 7/1")
    contents = ResultsStore(place).read()
    assert contents.unreadable == ()
    assert contents.table.equals(local.read().table)
    assert sorted(store.folder.names()) == sorted(local.folder.names())
    again = store.add(result(1, (0.1 + 0.2,), serial="Ø 7/1"))
    assert not again.new
    assert str(again.path).startswith(str(store.folder))
    assert store.add(result(1, (0.1 + 0.2,), serial="Ø 7/1", version="1.1")).new
    assert ResultsStore(place).read().table.num_rows == 4


def test_a_result_is_put_once_under_its_own_name():
    there = bucket()
    store = fill(URL, 0.8)
    before = dict(there.objects)
    assert not store.add(result(0)).new
    assert there.puts == [f"{BUCKET}/line 1/{PROBE}", f"{BUCKET}/line 1/{result(0).file_name}"]
    assert there.objects == before


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (NO_BUCKET, "there is no such bucket, folder or file"),
        (DENIED, "Access Denied"),
        (FULL, "No space left on device"),
        (NO_LOGIN, "Unable to locate credentials"),
        (SILENT, "TimeoutError"),
    ],
)
def test_a_store_that_cannot_be_written_is_named_before_anything(error, words):
    def fault(operation, key):
        raise error

    there = bucket(fault)
    with pytest.raises(ResultsError) as caught:
        ResultsStore(URL).make()
    assert str(caught.value) == f"{SHOWN}: cannot store results there: {words}"
    assert there.objects == {}


@pytest.mark.parametrize("error", [NO_BUCKET, DENIED, FULL, DROPPED, NO_LOGIN, SILENT])
@pytest.mark.parametrize("atomic", [True, False])
def test_a_put_that_breaks_off_leaves_nothing(error, atomic):
    there = bucket(atomic=atomic)
    store = fill(URL, 0.8)
    before = dict(there.objects)
    there.fault = staticmethod(failing(error, "put"))
    with pytest.raises(ResultsError, match=rf"^{SHOWN}: cannot store the result: [^\n]+$"):
        store.add(result(1))
    assert there.objects == before
    there.fault = staticmethod(lambda operation, key: None)
    assert store.add(result(1)).new
    assert store.read().unreadable == ()


def test_half_of_a_file_that_cannot_be_removed_is_named_and_replaced():
    """Where a put is not atomic (SFTP, SMB) and the line stays down."""
    there = bucket(atomic=False)
    store = fill(URL, 0.8)
    there.fault = staticmethod(failing(DROPPED, "put", "get", "rm"))
    with pytest.raises(ResultsError, match="Connection reset by peer"):
        store.add(result(1))
    there.fault = staticmethod(lambda operation, key: None)
    [line] = store.read().unreadable
    assert line.startswith(f"{SHOWN}/{result(1).file_name}: no Parquet file")
    assert store.read().table.num_rows == 1
    assert store.add(result(1)).new
    assert (store.read().unreadable, store.read().table.num_rows) == ((), 2)


@pytest.mark.parametrize("operation", ["ls", "get"])
def test_nothing_is_put_while_it_is_not_known_what_is_there(operation):
    """Else a line that drops for a moment would make a second file of the same analysis."""
    there = bucket()
    store = fill(URL, 0.8)
    puts = list(there.puts)
    there.fault = staticmethod(failing(DROPPED, operation))
    with pytest.raises(ResultsError, match="cannot store the result: Connection reset by peer"):
        store.add(result(0))
    assert there.puts == puts


def test_what_cannot_be_fetched_is_named_and_the_rest_is_read():
    there = bucket()
    store = fill(URL, [0.8, 0.9])
    bad = f"{BUCKET}/line 1/{result(1, (0.9,)).file_name}"

    def fault(operation, key):
        if key == bad and operation == "get":
            raise DENIED

    there.fault = staticmethod(fault)
    contents = store.read()
    assert contents.unreadable == (f"{SHOWN}/{Path(bad).name}: Access Denied",)
    assert contents.table["value"].to_pylist() == [0.8]


@pytest.mark.parametrize(
    ("error", "said"),
    [(NO_BUCKET, "there is no results store"), (DENIED, "cannot read the results store: Access")],
)
def test_a_store_that_is_not_there_is_named(error, said):
    bucket(failing(error, "ls"))
    with pytest.raises(ResultsError, match=f"^{SHOWN}: {said}"):
        ResultsStore(URL).read()


def test_a_probe_that_may_not_be_deleted_is_no_result():
    def fault(operation, key):
        if operation == "rm":
            raise DENIED

    there = bucket(fault)
    store = fill(URL, 0.8)
    assert f"{BUCKET}/line 1/{PROBE}" in there.objects
    assert (store.read().unreadable, store.read().table.num_rows) == ((), 1)


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("s3://bucket/store", "s3://bucket/store: needs another package: .*s3fs"),
        ("gs://bucket", "gs://bucket: needs another package: .*gcsfs"),
        ("s3://key:secret@bucket/store", "^s3://bucket/store: needs"),
        ("nonsense://a", "nonsense://a: cannot be a results store: .*nonsense"),
        ("memory://motors/line[1]", "has one of the characters"),
        ("file://elsewhere/a", "file://elsewhere/a: of another computer"),
    ],
)
def test_a_url_that_cannot_be_opened_is_named(url, said):
    with pytest.raises(ResultsError, match=said) as caught:
        ResultsStore(url)
    assert "secret" not in str(caught.value)
    assert "\n" not in str(caught.value)


def test_without_fsspec_it_is_said_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(ResultsError, match=r"fsspec: pip install 'motord\[remote\]'"):
        ResultsStore("s3://bucket/store")
    assert fill(tmp_path / "s", 0.8).read().table.num_rows == 1


def test_a_file_url_is_a_local_folder(tmp_path):
    folder = tmp_path / "with space"
    fill(folder.as_uri(), 0.8)
    [path] = folder.iterdir()
    assert ResultsStore(folder.as_uri()).folder.path_of(path.name) == Path(path)
