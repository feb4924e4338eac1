"""A first bench file: an example that ships with motord, adapted by answers, with a comment a key.

`templates` are the examples, `questions` what is asked of each, `content` puts the answers in,
`commented` writes it as TOML. `new_bench_file` does all of it and checks the result.
"""

from pathlib import Path

from motord.bench_file.commented import CHECK, commented
from motord.bench_file.content import Answers, Ask, adapt
from motord.bench_file.templates import INVERTERS, TEMPLATES, Template, known, notes
from motord.config import Config, ConfigError
from motord.config.reading import check_text

__all__ = ["CHECK", "INVERTERS", "TEMPLATES", "Answers", "Template", "new_bench_file"]


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
