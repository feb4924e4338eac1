"""No process of motord loads a module from the folder in which it is started."""

import subprocess
from pathlib import Path

from motord import module_command as shown
from motord.module_command import module_command

SOURCES = Path(shown.__file__).parent


def test_a_module_in_the_working_folder_is_not_loaded(tmp_path: Path) -> None:
    (tmp_path / "this.py").write_text("raise SystemExit(3)")
    assert subprocess.run(module_command("this"), cwd=tmp_path, capture_output=True).returncode == 0


def test_every_process_is_started_so() -> None:
    own = Path(shown.__file__)
    others = [p for p in SOURCES.rglob("*.py") if p != own and "sys.executable, " in p.read_text()]
    assert others == []
