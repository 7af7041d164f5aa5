"""`python -m jaxdem`, the same as the command `jaxdem`."""

from jaxdem.cli import main

main()
