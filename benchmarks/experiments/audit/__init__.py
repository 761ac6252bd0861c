"""Are the established integrators what their packages claim?"""
