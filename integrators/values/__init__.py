"""The kinds of number that a step runs on: tuples, arrays, arrays in place, SIMD lanes."""
