"""Scripts that test what packages' documentation says; each needs its package alone."""
