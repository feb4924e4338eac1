"""A result as wide as the terminal, in words and, where that can show them, in colour."""

from motord.cli.console import plain_console

STYLES = {
    "pass": "bold black on green",
    "fail": "bold white on red",
    "undecidable": "bold black on yellow",
    "error": "bold white on magenta",
}


def print_banner(decision: str, text: str) -> None:
    """Print a decision and what it is of on stdout; without colours between two lines of `=`."""
    from rich.padding import Padding
    from rich.text import Text

    console = plain_console()
    words = Text(f"{decision.upper()}  {text}", justify="center", overflow="fold")
    if console.color_system is None or console.no_color:
        edge = Text("=" * console.width)
        for line in (edge, words, edge):
            console.print(line)
    else:
        console.print(Padding(words, (1, 0), style=STYLES[decision]))
