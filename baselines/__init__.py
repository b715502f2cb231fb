"""Other methods behind the interface of fieldcalib. They import fieldcalib, never the reverse."""

from fieldcalib.processes.threads import one_thread_for_blas

one_thread_for_blas()  # before NumPy is imported: results then do not depend on the machine or on --jobs
