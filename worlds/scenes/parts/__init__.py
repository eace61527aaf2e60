"""Parts that the generated scenes are made of: layouts, furniture, populations of movers."""
