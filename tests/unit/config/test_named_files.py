"""Files that a bench file names, kept as the daemon read them."""

import errno
from pathlib import Path

import pytest

from motord.atomic_write import write_cached
from motord.config import Config, keep, load_started
from tests.unit.config.test_config import BENCH

CHANNEL = """
[[channels]]
name = "t_C"
unit = "degC"
source = {driver = "can", dbc = "channel.dbc", signal = "A.B", bus = {channel = "can1"}}
"""
ACCESS = """
[zenoh]
listen = ["tcp/127.0.0.1:7447", "tls/0.0.0.0:7448"]
tls = {ca = "ca.pem", certificate = "daemon.pem", key = "daemon.key", roles = "roles.toml"}
"""
FILES = '[bench]\nrig = "rig.toml"\nfaults = "faults.toml"'
TEXT = BENCH.replace("[bench]", FILES) + CHANNEL + ACCESS
NAMED = ("rig.toml", "faults.toml", "channel.dbc")
OF_ACCESS = ("ca.pem", "daemon.pem", "daemon.key", "roles.toml")


class Started:
    """A bench whose daemon has read its files."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.path, self.kept = folder, folder / "bench.toml", folder / "run/bench.toml"
        self.kept.parent.mkdir()
        self.path.write_text(TEXT)
        for name in (*NAMED, *OF_ACCESS):
            (folder / name).write_text(f"{name} as it was")
        keep(self.path, TEXT, self.kept)

    def files(self) -> list[Path]:
        """Return the files of a process that is started now."""
        config, text = load_started(self.path, self.kept)
        assert text == TEXT
        return [*named(config), *access(config)]


def named(config: Config) -> list[Path]:
    rig, faults = config.bench.rig, config.bench.faults
    assert rig is not None
    assert faults is not None
    source = config.channels[0].source
    assert source.driver == "can"
    return [rig, faults, source.dbc]


def access(config: Config) -> list[Path]:
    tls = config.zenoh.tls
    assert tls is not None
    return [tls.ca, tls.certificate, tls.key, tls.roles]


@pytest.fixture
def started(tmp_path: Path) -> Started:
    return Started(tmp_path)


def test_files_that_are_as_they_were_are_read_where_they_are(started: Started) -> None:
    assert started.files() == [started.folder / name for name in (*NAMED, *OF_ACCESS)]


@pytest.mark.parametrize("name", NAMED)
@pytest.mark.parametrize("how", ["edited", "gone"])
def test_a_file_is_as_it_was_whatever_became_of_it(started: Started, name: str, how: str) -> None:
    if how == "edited":
        (started.folder / name).write_text("another")
    else:
        (started.folder / name).unlink()
    texts = [file.read_text() for file in started.files()]
    assert texts == [f"{name} as it was" for name in (*NAMED, *OF_ACCESS)]


def test_certificates_and_roles_are_read_anew_and_no_key_is_copied(started: Started) -> None:
    for name in OF_ACCESS:
        (started.folder / name).write_text("renewed")
    assert [file.read_text() for file in started.files()[len(NAMED) :]] == ["renewed"] * 4
    copies = [file.read_text() for file in started.kept.parent.iterdir() if file != started.kept]
    assert sorted(copies) == sorted(f"{name} as it was" for name in NAMED)


def test_a_file_that_was_not_there_is_read_where_it_is(tmp_path: Path) -> None:
    kept = tmp_path / "kept.toml"
    path = tmp_path / "bench.toml"
    keep(path, TEXT, kept)
    config, _ = load_started(path, kept)
    assert named(config) == [tmp_path / name for name in NAMED]


def test_a_table_of_the_back_emf_is_the_one_that_the_daemon_read(tmp_path: Path) -> None:
    text = BENCH.replace("[{order = 1, amplitude_V_s_per_rad = 0.2}]", '"k.json"')
    path, kept, table = tmp_path / "bench.toml", tmp_path / "kept.toml", tmp_path / "k.json"
    path.write_text(text)
    for k in (0.5, 0.7):
        table.write_text(f'{{"k_V_s_per_rad": {[[k] * 3] * 4096}}}')
        if not kept.exists():
            keep(path, text, kept)
    assert load_started(path, kept)[0].motor.back_emf_table().max() == 0.5


def test_a_file_of_which_no_copy_can_be_kept_is_read_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Say for want of space in the memory where the copies are."""

    def full(path: Path, content: object) -> None:
        if path.suffix == ".named":
            raise OSError(errno.ENOSPC, "No space left on device")
        write_cached(path, content)  # type: ignore[arg-type]

    monkeypatch.setattr("motord.config.named_files.write_cached", full)
    started = Started(tmp_path)
    (tmp_path / "rig.toml").write_text("another")
    assert started.files()[0].read_text() == "another"
