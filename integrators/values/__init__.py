"""The kinds of numbers that a step is computed with: tuples, arrays, arrays in place, SIMD lanes."""
