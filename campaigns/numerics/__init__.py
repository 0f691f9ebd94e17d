"""Pure mathematics: arrays in, arrays out. No files, no clock, no devices."""
