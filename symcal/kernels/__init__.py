"""CasADi functions as fast batched machine code, falling back to CasADi's virtual machine."""

from symcal.kernels.batch import BatchFunction, batch_function

__all__ = ["BatchFunction", "batch_function"]
