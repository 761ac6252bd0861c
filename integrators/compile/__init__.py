"""From formulas to machine code: source text, the compiler, and the cache of both."""
