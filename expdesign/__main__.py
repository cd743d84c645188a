"""`python -m expdesign`: the command line."""

from expdesign.cli import main

if __name__ == "__main__":
    main()
