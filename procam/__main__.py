"""`python -m procam`: the commands, as `procam`."""

from procam.interfaces.cli.main import main

main()
