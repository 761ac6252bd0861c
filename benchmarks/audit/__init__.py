"""The audit: measure integrators of other packages as black boxes, and judge what their packages claim."""
