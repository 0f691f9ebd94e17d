#!/bin/sh
# Starts the bridge of pkmcal, whose folder `drivers` lies beside this file.
PYTHONPATH=$(dirname "$0") exec /usr/bin/python3 -m drivers.linuxcnc_bridge "$@"
