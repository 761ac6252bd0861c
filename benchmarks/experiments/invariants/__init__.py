"""What is kept over long times?"""
