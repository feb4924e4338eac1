"""The command `motord`, and `python -m motord`."""

import sys


def main() -> None:
    """Run the command line; one that is interrupted before it has begun says so, too."""
    try:
        from motord.process.collector_pause import collector_paused

        with collector_paused():
            from motord.cli import main as command_line

        command_line()
    except KeyboardInterrupt:
        sys.stderr.write("motord: interrupted\n")
        sys.exit(1)
    finally:
        # CPython remembers an interrupt in an exec, as dataclasses are made by, until the next one,
        # and ends `python -m` by SIGINT though it was taken
        exec("")


if __name__ == "__main__":
    main()
