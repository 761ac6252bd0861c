"""Does the advice meet the requested accuracy, and how close to the fastest integrator is it?"""
