"""The kernels, one family a module."""
