"""Recordings without a master: read a bag, drive cues and tracker through it, score and write the tracks."""

import os

# The matrices are small: OpenBLAS's threads only wait for each other. Counts only if NumPy is not loaded yet.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
