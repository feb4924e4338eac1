"""Who is in command: one holder for each process, and tokens that die with theirs."""

import json
import os
import re
import signal
import socket
import stat
import subprocess
import sys
import threading

import pytest
from pydantic import ValidationError

from motord.api.plan_messages import PlanView
from motord.api.requests import LeaseAcquire
from motord.cli.bench import shared_token
from motord.cli.bench.lease_session import in_command, interrupted_once
from motord.client import ClientError, Lease, holder, operator


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


def test_a_holder_is_user_and_host_terminal_and_process(monkeypatch):
    monkeypatch.setattr(holder, "_user", lambda: "anna")
    monkeypatch.setattr(socket, "gethostname", lambda: "bench")
    monkeypatch.setattr(os, "ttyname", lambda descriptor: "/dev/pts/3")
    assert operator() == f"anna@bench pts/3 {os.getpid()}"
    assert LeaseAcquire(holder=operator()).holder == operator()


@pytest.mark.parametrize("host", ["h" * 300, "böse-kiste", "a,b|c\n"])
def test_any_name_of_user_and_host_makes_a_holder_that_the_daemon_takes(monkeypatch, host):
    monkeypatch.setattr(holder, "_user", lambda: "CORP\\anna+b")
    monkeypatch.setattr(socket, "gethostname", lambda: host)
    monkeypatch.setattr(os, "ttyname", lambda descriptor: "/dev/pts/3")
    assert LeaseAcquire(holder=operator()).holder.endswith(f" pts/3 {os.getpid()}")


def test_a_holder_that_cannot_be_is_refused_by_what_it_takes():
    with pytest.raises(ValidationError, match=r"takes letters, digits, spaces, _, \., @"):
        LeaseAcquire(holder="anna (lab)")


def test_without_a_terminal_or_an_entry_of_the_user_there_is_a_holder_too(monkeypatch):
    def none(*_):
        raise OSError

    monkeypatch.setattr(os, "ttyname", none)
    monkeypatch.setattr("getpass.getuser", none)
    assert re.fullmatch(rf"uid{os.getuid()}@\S+ {os.getpid()}", operator())


HOLDER = """
import sys
from motord.cli.bench.shared_token import shared
with shared("b", sys.argv[1]):
    print("shared", flush=True)
    sys.stdin.read()
"""


def terminal(token):
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDER, token], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert process.stdout.readline() == b"shared\n"
    return process


def close(process):
    process.stdin.close()
    process.stdout.close()
    process.wait()


def test_the_token_of_a_killed_command_is_not_used_again():
    process = terminal("first")
    assert shared_token.tokens("b") == ["first"]
    process.kill()
    os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)  # dead, and not yet waited for
    assert shared_token.tokens("b") == []
    close(process)
    assert list(shared_token.folder("b").iterdir()) == []


def test_another_process_of_the_same_number_is_another_one():
    with shared_token.shared("b", "mine"):
        [path] = shared_token.folder("b").iterdir()
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        before = path.with_name(f"{os.getpid()}-1.json")
        before.write_text(json.dumps({"token": "of an earlier process"}))
        assert shared_token.tokens("b") == ["mine"]


def test_who_loses_command_leaves_the_token_of_the_winner():
    loser, winner = terminal("loser"), terminal("winner")
    assert shared_token.tokens("b") == ["winner", "loser"]
    close(loser)
    assert shared_token.tokens("b") == ["winner"]
    close(winner)
    assert shared_token.tokens("b") == []


def test_a_file_that_somebody_else_wrote_is_left_alone():
    with shared_token.shared("b", "mine"):
        [path] = shared_token.folder("b").iterdir()
        path.write_text(json.dumps({"token": "theirs"}))
    assert path.exists()


class Daemon:
    """Grants a lease and notes what is asked of it; `on` is called for a request by its name."""

    bench = "b"
    lease_s = 5.0

    def __init__(self, **on):
        self.asked, self.on = [], on
        self.run_id = ""

    def plan(self):
        running = PlanView(plan="cogging", state="running", points=1, run_id=self.run_id)
        return running if self.run_id else None

    def call(self, rpc, /, **arguments):
        self.asked.append(rpc.name)
        if rpc.name in self.on:
            self.on[rpc.name]()
        if rpc.name == "plan/abort":
            return None
        times = {"lease_s": self.lease_s, "renew_within_s": self.lease_s}
        return rpc.reply.model_validate({"token": "t", "took_over_from": None, **times})

    def lease(self, *, force=False):
        return Lease(self, "anna", force=force)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_each_signal_ends_the_block_once_and_the_lease_is_given_back(number):
    daemon = Daemon(**{"lease/release": lambda: os.kill(os.getpid(), number)})
    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt), in_command(daemon):
        os.kill(os.getpid(), number)
    assert daemon.asked == ["lease/acquire", "lease/release"]
    assert signal.getsignal(number) is before
    assert shared_token.tokens("b") == []


def test_a_second_signal_does_not_disturb_the_clearing_up():
    with interrupted_once():
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGHUP)
        os.kill(os.getpid(), signal.SIGTERM)
        os.kill(os.getpid(), signal.SIGINT)


def test_signals_that_are_ignored_stay_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interrupted_once():
            os.kill(os.getpid(), signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_lease_granted_while_interrupted_is_given_back():
    daemon = Daemon()
    lease = daemon.lease()

    def interrupted():
        raise KeyboardInterrupt

    acquire = lease.acquire
    lease.acquire = lambda: (acquire(), interrupted())
    with pytest.raises(KeyboardInterrupt), lease:
        pass
    assert daemon.asked[-1] == "lease/release"


def test_a_daemon_that_hangs_does_not_hold_up_the_end_of_a_command():
    hangs, asked = threading.Event(), threading.Event()

    def renew():
        asked.set()
        hangs.wait(60.0)

    daemon = Daemon(**{"lease/renew": renew})
    daemon.lease_s = 0.1
    lease = daemon.lease()
    lease.acquire()
    assert asked.wait(60.0)
    lease.release()
    assert "does not answer" in lease.why
    assert "lease/release" not in daemon.asked
    hangs.set()


@pytest.mark.parametrize("begins", [True, False], ids=["its own", "another command's"])
def test_a_plan_that_began_under_the_lease_of_another_command_ends_with_an_interrupt(begins):
    """Its start may not have been answered yet. One that ran before goes on."""
    daemon = Daemon()
    daemon.run_id = "" if begins else "before"

    def start():
        with in_command(daemon) as session:
            assert session.lease is None
            daemon.run_id = daemon.run_id or "mine"
            os.kill(os.getpid(), signal.SIGINT)

    with shared_token.shared("b", "t"), pytest.raises(KeyboardInterrupt):
        start()
    assert daemon.asked == ["lease/renew", *(["plan/abort"] if begins else [])]


def test_a_token_that_the_daemon_refuses_is_not_used():
    def refuse():
        raise ClientError("no_lease", "over")

    daemon = Daemon(**{"lease/renew": refuse})
    with shared_token.shared("b", "old"), in_command(daemon) as command:
        assert command.lease is not None
    assert daemon.asked == ["lease/renew", "lease/acquire", "lease/release"]
