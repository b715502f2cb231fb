"""Other methods behind the interface of fieldcalib. They import fieldcalib, never the reverse."""

from fieldcalib.processes.threads import one_thread_for_blas

one_thread_for_blas()  # before NumPy: the results of a command are those of any machine, and of any --jobs
