"""`python -m estimable`: the command line."""

from .commands import main

main()
