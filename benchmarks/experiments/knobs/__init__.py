"""What does turning a knob of a method give, and cost?"""
