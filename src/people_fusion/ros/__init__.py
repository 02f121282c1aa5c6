"""The only floor that imports rospy, tf2 or messages."""

import os

# Matrices are tiny here. A second OpenBLAS thread does nothing but spin: 9 of 12.7 s of CPU in a minute of recording.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
