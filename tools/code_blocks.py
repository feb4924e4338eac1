"""The fenced blocks of code in README and documentation, and the commands in them."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
REFERENCE = DOCS / "reference"


@dataclass(frozen=True)
class Block:
    """A block: where it is, in which language, its text."""

    file: str
    line: int
    language: str
    text: str

    @property
    def first(self) -> str:
        """Its first line."""
        return self.text.split("\n", 1)[0]

    @property
    def key(self) -> tuple[str, str]:
        """File and first line, which stay when text above the block grows."""
        return self.file, self.first


def pages() -> list[Path]:
    """Return README, CONTRIBUTING, every page of the documentation, and the firmware's."""
    firmware = sorted((ROOT / "firmware_bridge").rglob("README.md"))
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md")), *firmware]


def blocks(files: Iterable[Path]) -> list[Block]:
    """Return the blocks of these files. Blocks with prompts and no language are `console`."""
    found = []
    for file in files:
        text = file.read_text(encoding="utf-8")
        for match in re.finditer(r"^```([\w-]*)[^\n]*\n(.*?)^```$", text, re.M | re.S):
            line = text.count("\n", 0, match.start()) + 1
            prompts = not match[1] and re.search(r"^\$ ", match[2], re.M)
            language = "console" if prompts else match[1]
            found.append(Block(str(file.relative_to(ROOT)), line, language, match[2]))
    return found


def commands(block: Block) -> list[str]:
    """Return the single commands of a block: prompts, comments and what they print left out."""
    lines = re.sub(r"\s*\\\n\s*", " ", block.text).splitlines()
    if any(line.startswith("$ ") for line in lines):
        lines = [line[2:] for line in lines if line.startswith(("$ ", "# "))]
    whole = [re.sub(r"(^|\s)#.*", "", line).strip() for line in lines]
    return [part.strip() for line in whole for part in re.split(r"&&|\|", line) if part.strip()]
