"""Certificates, roles, identities: made once, never overwritten, wrong ones named."""

import errno
import os
import stat
import tomllib

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import serialization
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from motord.cli.security import app
from motord.config import ConfigError, load, packaged
from motord.security import authority, identity, roles
from motord.security.access import access_control
from motord.security.roles import Role, SecurityError

RUN = CliRunner()


@pytest.fixture
def folder(tmp_path):
    authority.init(tmp_path / "ca", ["bench.lab", "192.168.7.5"])
    return tmp_path / "ca"


def certificate(path):
    return x509.load_pem_x509_certificate(path.read_bytes())


def test_keys_are_private_and_certificates_are_what_they_should_be(folder):
    own = authority.add(folder, "anna", Role.OPERATOR, days=30)
    for key in (folder / "ca.key", folder / "server.key", own / "key.pem"):
        assert stat.S_IMODE(key.stat().st_mode) == 0o600
    server = certificate(folder / "server.pem")
    names = server.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert set(names.get_values_for_type(x509.DNSName)) == {"localhost", "bench.lab"}
    assert "192.168.7.5" in map(str, names.get_values_for_type(x509.IPAddress))
    client = certificate(own / "certificate.pem")
    client.verify_directly_issued_by(certificate(folder / "ca.pem"))
    assert client.subject.rfc4514_string() == "CN=anna"
    life = client.not_valid_after_utc - client.not_valid_before_utc
    assert life.days == 30
    for made, usage in ((server, "serverAuth"), (client, "clientAuth")):
        usages = made.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
        assert [use._name for use in usages] == [usage]
        limits = made.extensions.get_extension_for_class(x509.BasicConstraints).value
        assert limits.ca is False
    assert identity.load(own).role == "operator"


def test_nothing_is_overwritten(folder):
    authority.add(folder, "anna", Role.OPERATOR)
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    with pytest.raises(SecurityError, match="exists; nothing is overwritten"):
        authority.init(folder, [])
    with pytest.raises(SecurityError, match="anna is taken"):
        authority.add(folder, "anna", Role.VIEWER)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
    (folder / "clients" / "anna").rename(folder.parent / "of_anna")
    authority.remove(folder, "anna")
    with pytest.raises(SecurityError, match="anna is taken"):
        authority.add(folder, "anna", Role.VIEWER)
    with pytest.raises(SecurityError, match="there is no anna"):
        authority.remove(folder, "anna")


@pytest.mark.parametrize("failing", range(5))
def test_what_cannot_be_made_whole_leaves_nothing(tmp_path, monkeypatch, failing):
    authority.init(tmp_path / "ca", [])
    before = sorted(tmp_path.rglob("*"))
    real, calls = os.fsync, iter(range(9))

    def full(descriptor):
        if next(calls) == failing:
            raise OSError(errno.ENOSPC, "No space left on device")
        real(descriptor)

    with monkeypatch.context() as patched:
        patched.setattr("os.fsync", full)
        with pytest.raises((SecurityError, OSError), match="No space left"):
            authority.init(tmp_path / "other", [])
        calls = iter(range(9))
        with pytest.raises((SecurityError, OSError), match="No space left"):
            authority.add(tmp_path / "ca", "anna", Role.VIEWER)
    left = {path.name for path in set(tmp_path.rglob("*")) - set(before)}
    assert left == {"other", "clients"}
    authority.init(tmp_path / "other", [])
    authority.add(tmp_path / "ca", "anna", Role.VIEWER)


def test_two_that_make_an_authority_at_a_time_leave_that_of_the_first(tmp_path, monkeypatch):
    """The second one found nothing when it looked, and removed the keys of the first."""
    folder = tmp_path / "ca"

    def sign(*arguments):
        monkeypatch.setattr(authority, "_sign", signed)
        authority.init(folder, [])
        return signed(*arguments)

    signed = authority._sign
    monkeypatch.setattr(authority, "_sign", sign)
    with pytest.raises(SecurityError, match=r"ca\.key: cannot make it: File exists"):
        authority.init(folder, [])
    assert len(list(folder.iterdir())) == 5
    authority.add(folder, "anna", Role.VIEWER)


@pytest.mark.parametrize("name", ["", "../anna", "an na", "a/b", "-a", "é", "x" * 64, 'a"b', "a)+"])
def test_names_that_could_mean_something_else_are_refused(folder, name):
    with pytest.raises(SecurityError, match="cannot be a name"):
        authority.add(folder, name, Role.VIEWER)


@pytest.mark.parametrize("host", ["", "a b", "http://x", "ü"])
def test_hosts_that_are_none_are_refused(tmp_path, host):
    with pytest.raises(SecurityError, match="neither a host name"):
        authority.init(tmp_path / "ca", [host])
    assert not (tmp_path / "ca").exists()


@given(st.dictionaries(st.from_regex(roles.NAME, fullmatch=True), st.sampled_from(Role)))
def test_roles_come_back_as_written(tmp_path_factory, given_roles):
    path = tmp_path_factory.mktemp("roles") / "roles.toml"
    roles.write(path, given_roles)
    assert roles.read(path) == given_roles


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", r"expected one table \[roles\]"),
        ("[roles]\nanna = 1", "anna = 1: a role is one of"),
        ("[roles]\nanna = 'root'", "'root': a role is one of"),
        ("[roles]\n'a b' = 'viewer'", "is no name"),
        ("[roles]\n[more]", "expected one table"),
        ("roles", "not valid TOML"),
    ],
)
def test_wrong_roles_are_named(tmp_path, text, expected):
    path = tmp_path / "roles.toml"
    path.write_text(text)
    with pytest.raises(SecurityError, match=expected):
        roles.read(path)


def test_roles_that_init_makes_name_it(tmp_path):
    with pytest.raises(
        SecurityError, match=f"cannot read the roles.*`motord security init {tmp_path}`"
    ):
        roles.read(tmp_path / "roles.toml")


def test_roles_that_init_would_not_make_are_to_be_written(folder, tmp_path):
    (folder / roles.ROLES).unlink()
    for path in (folder / roles.ROLES, tmp_path / "mine.toml"):
        with pytest.raises(SecurityError, match=r"cannot read the roles.*; write it: .*\[roles\]"):
            roles.read(path)


def test_a_folder_with_a_blank_is_quoted(tmp_path):
    with pytest.raises(SecurityError, match=f"`motord security init '{tmp_path}/a b'`"):
        roles.read(tmp_path / "a b" / "roles.toml")


def test_files_that_do_not_belong_together_are_refused(folder, tmp_path):
    own = authority.add(folder, "anna", Role.VIEWER)
    with pytest.raises(SecurityError, match="no certificate and its key"):
        identity.check_files(folder / "ca.pem", own / "certificate.pem", folder / "server.key")
    with pytest.raises(SecurityError, match="holds no certificate of an authority"):
        identity.check_files(folder / "ca.key", own / "certificate.pem", own / "key.pem")
    with pytest.raises(SecurityError, match="cannot read it"):
        identity.check_files(tmp_path / "x", own / "certificate.pem", own / "key.pem")
    with pytest.raises(SecurityError, match="motord security add"):
        identity.load(tmp_path)
    (own / "identity.toml").write_text("name = 'anna'")
    with pytest.raises(SecurityError, match="not an identity"):
        identity.load(own)


def test_encrypted_keys_are_refused_and_nobody_is_asked_for_a_passphrase(folder):
    own = authority.add(folder, "anna", Role.VIEWER)
    for path in (own / "key.pem", folder / "ca.key"):
        key = serialization.load_pem_private_key(path.read_bytes(), None)
        path.write_bytes(
            key.private_bytes(
                serialization.Encoding.PEM,
                serialization.PrivateFormat.PKCS8,
                serialization.BestAvailableEncryption(b"secret"),
            )
        )
    with pytest.raises(SecurityError, match="not encrypted"):
        identity.load(own)
    with pytest.raises(SecurityError, match=r"ca\.key: it is encrypted"):
        authority.add(folder, "ben", Role.VIEWER)


def test_an_authority_must_be_there(tmp_path, folder):
    with pytest.raises(SecurityError, match="makes an authority"):
        authority.add(tmp_path, "anna", Role.VIEWER)
    (folder / "ca.key").write_text("nothing")
    with pytest.raises(SecurityError, match="not a PEM file"):
        authority.add(folder, "anna", Role.VIEWER)
    with pytest.raises(SecurityError, match="not a certificate"):
        authority.ends(folder / "ca.key")


def test_only_operators_may_command():
    access = access_control("b", {"anna": Role.OPERATOR, "ben": Role.VIEWER})
    assert access["default_permission"] == "deny"
    rules = {rule["id"]: rule for rule in access["rules"]}
    for policy in access["policies"]:
        keys = {k for name in policy["rules"] for k in rules[name]["key_exprs"]}
        assert ("motord/b/rpc/**" in keys) == (policy["subjects"] == ["operator"])
        assert ("**" in keys) == ("daemon" in policy["subjects"])
    for name in ("watch", "look", "command"):
        assert not {"put", "delete", "reply", "declare_queryable"} & set(rules[name]["messages"])
    assert [s["id"] for s in access_control("b", {})["subjects"]] == ["daemon", "daemon_socket"]


def test_by_command(tmp_path):
    folder = str(tmp_path / "ca")
    made = RUN.invoke(app, ["init", folder, "--host", "bench.lab"])
    assert made.exit_code == 0
    section = tomllib.loads(made.stdout)["zenoh"]
    text = packaged("sim.toml").read_text()
    text = text.replace('rig = "report.rig.toml"', 'rig = "package:report.rig.toml"')
    bench = tmp_path / "bench.toml"
    bench.write_text(text + made.stdout)
    assert load(bench).zenoh.remote == ("tls/0.0.0.0:7448",)
    assert str(load(bench).zenoh.tls.ca) == section["tls"]["ca"]
    assert RUN.invoke(app, ["init", folder]).exit_code == 1
    for name, role in (("anna", "operator"), ("ben", "viewer")):
        assert RUN.invoke(app, ["add", name, "--role", role, "--in", folder]).exit_code == 0
    listed = RUN.invoke(app, ["list", "--in", folder])
    assert "ben                      viewer    until 20" in listed.stdout
    assert '"name": "anna"' in RUN.invoke(app, ["list", "--in", folder, "--json"]).stdout
    assert RUN.invoke(app, ["remove", "ben", "--in", folder]).exit_code == 0
    assert "ben" not in RUN.invoke(app, ["list", "--in", folder]).stdout
    assert RUN.invoke(app, ["list", "--in", str(tmp_path)]).exit_code == 1


TLS = '[zenoh.tls]\nca = "a"\ncertificate = "b"\nkey = "c"\nroles = "d"\n'


@pytest.mark.parametrize(
    ("zenoh", "expected"),
    [
        ('listen = ["tcp/0.0.0.0:7447"]', "of this machine alone.*motord security init"),
        ('listen = ["tls/0.0.0.0:7448"]\n' + TLS, "of this machine alone"),
        ('listen = ["tcp/127.0.0.1:7447", "tls/0.0.0.0:7448"]', r"needs \[zenoh.tls\]"),
        ('listen = ["tcp/127.0.0.1:7447"]\n' + TLS, r"\[zenoh.tls\] without an endpoint"),
        ('listen = ["tcp/127.0.0.1:7447", "quic/0.0.0.0:7448"]\n' + TLS, "of this machine alone"),
        ('listen = ["tcp/127.0.0.1:1", "tcp/0.0.0.0:7448", "tls/h:1"]\n' + TLS, "machine alone"),
        ('listen = ["tcp/127.0.0.1:7447;tcp/0.0.0.0:1"]', "of this machine alone"),
        (
            'listen = ["tcp/127.0.0.1:1", "tls/[::]:2"]\n' + TLS.replace('roles = "d"\n', ""),
            "roles: missing",
        ),
    ],
)
def test_nothing_is_listened_on_beyond_this_machine_without_all_of_it(tmp_path, zenoh, expected):
    path = tmp_path / "bench.toml"
    text = packaged("sim.toml").read_text()
    text = text.replace('rig = "report.rig.toml"', 'rig = "package:report.rig.toml"')
    path.write_text(f"{text}\n[zenoh]\n{zenoh}\n")
    with pytest.raises(ConfigError, match=expected):
        load(path)
