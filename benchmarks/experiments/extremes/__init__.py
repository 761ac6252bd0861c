"""How far can a method be pushed: where it is stable, where it breaks, and how."""
