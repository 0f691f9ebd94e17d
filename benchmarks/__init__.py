"""Yardsticks: what the work costs and what it gives, beside limits."""

import os

os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1")
# before NumPy is imported, here and in every process started: limits are for one core, and the
# program itself keeps to one
