"""What is kept of semi-discretized wave equations?"""
