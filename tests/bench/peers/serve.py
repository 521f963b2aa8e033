"""A contender's side of the talk with compare.py: a word a line in, an answer a line out.

reconstruct, render    do it once; nanoseconds
output FILE            the numbers of the last rendering, as .npy; done
"""
import sys
import time

import numpy as np


def serve(about, reconstruct, render):
    """`render` returns [1, tokens, 3 q q] numbers, as a function to be called for an array."""
    print(about, flush=True)
    fetch = None
    for line in sys.stdin:
        word, *rest = line.split()
        start = time.perf_counter_ns()
        if word == "reconstruct":
            reconstruct()
        elif word == "render":
            fetch = render()
        if word == "output":
            np.save(rest[0], np.asarray(fetch(), np.float32))
            print("done", flush=True)
        else:
            print(time.perf_counter_ns() - start, flush=True)
