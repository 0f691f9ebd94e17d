"""Total stations that speak GeoCOM."""
