"""A new bench file, from questions to checked text."""

from pathlib import Path

from motord.bench_file.commented import commented
from motord.bench_file.content import Answers, Ask, adapt
from motord.bench_file.templates import TEMPLATES, known, notes
from motord.config import Config, ConfigError
from motord.config.reading import check_text


def new_bench_file(
    template: str, inverter: str, answers: Answers, ask: Ask | None, where: Path
) -> tuple[str, Config]:
    """Return the text of a new bench file, and the bench that it describes.

    answers: by key, such as `motor.pole_pairs`; ask: asked for what is missing, or None to take
    the defaults. where: the file's path, which other files are relative to. Raises ConfigError.
    """
    if template not in TEMPLATES:
        raise ConfigError(f"no template {template}; there are {', '.join(TEMPLATES)}")
    start = TEMPLATES[template]
    tables, answered = adapt(start, inverter, where, answers, ask)
    text = commented(tables, start, notes(start, inverter), answered | known(inverter))
    return text, check_text(where, text)
