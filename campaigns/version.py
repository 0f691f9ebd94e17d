"""The one place that holds the version of the software."""

VERSION = "0.1.0"
