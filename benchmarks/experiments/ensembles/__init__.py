"""What does one orbit cost in an ensemble of thousands?"""
