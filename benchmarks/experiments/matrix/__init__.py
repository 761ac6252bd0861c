"""Every method on every problem."""
