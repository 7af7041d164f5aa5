"""Learning a drag closure: dataset files, fits, training through the solver."""
