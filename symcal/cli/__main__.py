"""`python -m symcal.cli`."""

from symcal.cli import main

main()
