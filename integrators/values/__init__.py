"""The kinds of numbers that a step is computed with: tuples, arrays, arrays overwritten in place, SIMD lanes."""
