"""What is integrated: systems from formulae or from loops written by hand, and what is derived from them."""
