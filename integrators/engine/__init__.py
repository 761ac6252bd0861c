"""What every kernel is made of: vector operations, code generation, compilation, the solvers."""
