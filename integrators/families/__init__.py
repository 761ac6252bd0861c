"""The families of integration methods, one module for the step of each kind of method (see `stepping.kernel`)."""
