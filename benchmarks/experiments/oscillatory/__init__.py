"""Where do integrators for highly oscillatory systems resonate?"""
