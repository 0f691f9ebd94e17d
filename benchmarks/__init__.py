"""Benchmarks: what the work costs, what it gives, and what users rely on."""

import os

# Before NumPy is imported, here and in every process started: the program keeps to one core too.
os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1")
