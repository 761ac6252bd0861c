"""What does a step of many degrees of freedom cost?"""
