"""Studies at full size: what they run and train (plans), how their runs share the machine, and what is read from them."""
