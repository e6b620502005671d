"""Loops over pixels compiled by Numba, for the CPU: the same numbers as the step functions in torch, sooner.

Each file holds one kernel, under the file's own name. `switch` says when they are used, `load` compiles them. Nothing
here imports Numba before a kernel is wanted; without Numba, or with `NDTORCH_KERNELS=0`, torch does the work.
"""
