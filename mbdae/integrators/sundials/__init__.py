"""IDA and CVODE of SUNDIALS."""
