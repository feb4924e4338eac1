"""`python -m motord`."""

from motord.cli import main

if __name__ == "__main__":
    main()
