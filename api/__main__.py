"""`python -m edgemap`: the command line without its entry point script."""

from edgemap.cli import main

main()
