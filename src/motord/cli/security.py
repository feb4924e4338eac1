"""`motord security init|add|list|remove`: certificates and roles for other machines."""

import json
import shlex
from pathlib import Path
from typing import Annotated, Any

import typer

from motord import DEFAULT_ENDPOINT
from motord.cli.common_options import AsJson
from motord.cli.console import fail, group, print_line, print_result, remark
from motord.security import roles
from motord.security.roles import Role

app = group("Let other machines reach a bench: certificates and roles.")

EXTRA = "the certificates need the package cryptography: pip install 'motord[security]'"
LISTEN = "tls/0.0.0.0:7448"

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the authority.")]
In = Annotated[Path, typer.Option("--in", metavar="DIR", help="Folder of the authority.")]
Days = Annotated[
    int, typer.Option(min=1, max=3650, help="Days for which the certificate is valid.")
]


def _authority() -> Any:
    """Return the module; say in one line what is missing if the package cryptography is."""
    try:
        from motord.security import authority
    except ModuleNotFoundError as error:
        if error.name != "cryptography":
            raise
        fail(EXTRA)
    return authority


@app.command()
def init(
    folder: Folder,
    host: Annotated[
        list[str] | None,
        typer.Option("--host", metavar="NAME", help="Name or address of this machine; repeatable."),
    ] = None,
    days: Days = 730,
) -> None:
    """Make an authority, the daemon's certificate and an empty roles file; overwrite nothing."""
    _authority().init(folder, host or [], days)
    print_line(_section(folder.resolve()))
    remark(
        f"ca.key makes certificates: keep it from others, the daemon does not need it. Next: "
        f"motord security add NAME --role viewer|operator --in {shlex.quote(str(folder))}"
    )


def _section(folder: Path) -> str:
    names = (
        ("ca", "ca.pem"), ("certificate", "server.pem"), ("key", "server.key"),
        ("roles", roles.ROLES),
    )  # fmt: skip
    files = "\n".join(
        f"{key} = {json.dumps(str(folder / name), ensure_ascii=False)}" for key, name in names
    )
    return f"""\
# in the bench file:
[zenoh]
listen = ["{DEFAULT_ENDPOINT}", "{LISTEN}"]

[zenoh.tls]
{files}"""


@app.command()
def add(
    name: Annotated[str, typer.Argument(help="Who: a person or a program.")],
    role: Annotated[Role, typer.Option(help="What it may do.")],
    folder: In = Path(),
    days: Days = 730,
) -> None:
    """Make the certificate of a client and give it a role."""
    own = _authority().add(folder, name, role, days)
    print_line(f"{own}: take this folder to {name}'s machine, then there:")
    print_line(f"  motord status --connect tls/HOST:7448 --identity {own.name}")


@app.command("list")
def list_(
    folder: In = Path(),
    as_json: AsJson = False,
) -> None:
    """List who has which role, and until when the certificates are valid."""
    authority = _authority()
    given = roles.read(folder / roles.ROLES)
    ends = {"(authority)": folder / "ca.pem", "(daemon)": folder / "server.pem"}
    own = {name: folder / authority.CLIENTS / name / "certificate.pem" for name in given}
    rows = [
        {
            "name": name,
            "role": str(given.get(name, "")),
            "ends": authority.ends(path).isoformat() if path.exists() else None,
        }
        for name, path in {**ends, **own}.items()
    ]
    lines = []
    for row in rows:
        until = f"until {str(row['ends'])[:10]}" if row["ends"] else "certificate not here"
        lines.append(f"{row['name']:<24} {row['role']:<9} {until}")
    print_result(rows, "\n".join(lines), as_json)


@app.command()
def remove(
    name: Annotated[str, typer.Argument(help="Who: a person or a program.")], folder: In = Path()
) -> None:
    """Take the role of a client away: it may do nothing more, within seconds."""
    _authority().remove(folder, name)
    print_line(f"{name} has no role any more")
