"""What does an orbit cost when there are thousands of them?"""
