"""`python -m app`: the same as `pkmcal`."""

from app.main import main

main()
