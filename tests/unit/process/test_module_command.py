"""No process of motord loads a module from the folder in which it is started."""

import subprocess
import sys
from pathlib import Path

from motord.process import module_command as shown
from motord.process.module_command import module_command

SOURCES = Path(shown.__file__).parents[1]
WORKER = """
import multiprocessing, sys
from motord import cli
if __name__ == "__main__":
    sys.argv[1:] = ["--version"]
    cli.end_process = print  # it goes on
    cli.main()
    process = multiprocessing.get_context("spawn").Process(target=abs, args=(1,))
    process.start()
    process.join()
    sys.exit(process.exitcode)
"""


def test_a_module_in_the_working_folder_is_not_loaded(tmp_path: Path) -> None:
    (tmp_path / "this.py").write_text("raise SystemExit(3)")
    assert subprocess.run(module_command("this"), cwd=tmp_path, capture_output=True).returncode == 0


def test_every_process_is_started_so() -> None:
    own = Path(shown.__file__)
    others = [p for p in SOURCES.rglob("*.py") if p != own and "sys.executable, " in p.read_text()]
    assert others == []


def test_workers_of_a_command_do_not_load_it_either(tmp_path: Path) -> None:
    (tmp_path / "selectors.py").write_text("raise SystemExit(3)")
    script = tmp_path / "bin" / "command"
    script.parent.mkdir()
    script.write_text(WORKER)  # its own folder is on the path, as that of a console script is
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True)
    assert done.returncode == 0, done.stderr
