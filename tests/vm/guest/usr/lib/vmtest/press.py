#!/usr/bin/python3
"""press.py FILE MS: a hand on a button of gpio-sim, for so long."""
import sys
import time

with open(sys.argv[1], "w", buffering=1) as pull:
    pull.write("pull-down\n")
    time.sleep(float(sys.argv[2]) / 1000)
    pull.seek(0)
    pull.write("pull-up\n")
