"""What does a step cost for many degrees of freedom?"""
