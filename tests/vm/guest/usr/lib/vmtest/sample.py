#!/usr/bin/python3
"""sample.py FILE SECONDS: the first letter of a small file, read every 10 ms, in a row."""
import os
import sys
import time

file = os.open(sys.argv[1], os.O_RDONLY)
end = time.monotonic() + float(sys.argv[2])
while time.monotonic() < end:
    sys.stdout.write(os.pread(file, 1, 0).decode())
    time.sleep(0.01)
