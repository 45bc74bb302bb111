"""CasADi functions as fast batched machine code, or as numpy where there is no compiler."""

from symcal.kernels.batch import BatchFunction, PreparedCall, batch_function
from symcal.kernels.path import KernelPath, path_in_use

__all__ = ["BatchFunction", "KernelPath", "PreparedCall", "batch_function", "path_in_use"]
