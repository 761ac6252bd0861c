"""The families of integration methods: the step of each kind of method, one module each (see `stepping.kernel`)."""
