"""Episodes, methods, metrics and the commands that run them."""
