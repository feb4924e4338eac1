import os

import pytest
import serial

from motord.emulate import EmulatorError
from motord.emulate.pty import BACKLOG_BYTES, Pty


@pytest.fixture
def link(tmp_path):
    return tmp_path / "port"


@pytest.fixture
def pty(link):
    pty = Pty(link)
    yield pty
    pty.close()


def test_bytes_pass_both_ways_unchanged(pty, link):
    every = bytes(range(256))
    with serial.Serial(str(link), timeout=60, exclusive=True) as host:
        pty.write(every)
        assert host.read(256) == every
        host.write(every)
        host.flush()
        got = b""
        while len(got) < 256:
            got += pty.read()
        assert got == every
    assert pty.read() == b""


def test_the_link_goes_at_close(link):
    pty = Pty(link)
    assert str(link.readlink()) == pty.name
    assert pty.fileno() >= 0
    pty.close()
    pty.close()
    assert not link.is_symlink()


def test_a_link_left_behind_is_replaced(link):
    link.symlink_to("/dev/pts/4711")
    pty = Pty(link)
    assert str(link.readlink()) == pty.name
    pty.close()


def test_a_link_that_another_has_taken_is_left_alone(link):
    pty = Pty(link)
    link.unlink()
    link.symlink_to("/dev/pts/4711")
    pty.close()
    assert str(link.readlink()) == "/dev/pts/4711"


def test_a_real_file_is_not_replaced(link):
    link.write_text("precious")
    with pytest.raises(EmulatorError, match="exists and is not a symlink"):
        Pty(link)
    assert link.read_text() == "precious"


def test_a_link_to_something_else_is_not_replaced(link):
    link.symlink_to("/dev/ttyACM0")
    with pytest.raises(EmulatorError, match="a symlink to /dev/ttyACM0"):
        Pty(link)
    assert link.is_symlink()


def test_two_emulators_do_not_share_a_port(pty, link):
    with pytest.raises(EmulatorError, match="another emulator is serving this port"):
        Pty(link)
    assert str(link.readlink()) == pty.name


def test_a_folder_that_is_missing_is_reported(tmp_path):
    with pytest.raises(EmulatorError, match="cannot make the serial port there: No such file"):
        Pty(tmp_path / "nowhere" / "port")


def test_what_finds_no_room_is_refused_whole_and_the_rest_comes_later(pty, link):
    with serial.Serial(str(link), timeout=60) as host:  # opening discards what is waiting
        piece = b"x" * 1000
        taken = 0
        while pty.write(piece):
            taken += 1
            assert taken < 1000
        assert not pty.write(b"y" * (BACKLOG_BYTES + 1))
        wanted, got = taken * len(piece), b""
        while len(got) < wanted:
            got += os.read(host.fileno(), 65_536)
            pty.write(b"")
    assert got == b"x" * wanted
