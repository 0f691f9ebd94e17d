"""Run `pkmcal` by `python -m app`."""

from pkmcal import main

main()
