"""Run the command line as ``python -m lightwell_server.cli``."""

from lightwell_server.cli import main

main()
