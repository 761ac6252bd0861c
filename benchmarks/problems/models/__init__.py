"""Of a scene the models from the least to the full one, each with what it says of the full one's state."""
